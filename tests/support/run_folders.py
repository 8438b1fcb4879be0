"""A small finished run in a folder, with real demonstrations, for the tests of its report."""

import dataclasses

import numpy as np

from gril_jax.config import DemosConfig, RunConfig
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.demos.vision.video import write_video
from gril_jax.runs import run_dir
from gril_jax.runs.reading import read_phases, write_phases
from support.scenes import BLOCKS, GOAL, HALF_EXTENT, ROBOT, box_of, scene

OBJECTS = ("goal", "robot", *BLOCKS)
FRAMES = 8
RESULTS = {
    "tau": 0.912,
    "reward_time_tau": 0.834,
    "success": 0.9,
    "success_sampled": 0.8,
    "success_random": 0.05,
    "score": 0.93,
    "env_steps": 64000,
    "env_steps_per_s": 4321.0,
    "seconds": {"demonstrations": 3.0, "reward": 70.0},
    "trimmed_frames": 17,
    "eval_episodes": 20,
    "starts": 20,
    "variant": "jitter",
    "elsewhere_success": 0.25,
    "elsewhere_starts": 20,
    "elsewhere_variant": "layout",
    "demo_solved": True,
}


def moving_scene(frames=FRAMES, side=96):
    """Frames in which the green star moves left, and their exact tracks."""
    pictures, centers, sizes = [], [], []
    for t in range(frames):
        blocks = dict(BLOCKS)
        x, y, angle = blocks["green star"]
        blocks["green star"] = (x - 0.06 * t, y, angle)
        pictures.append(scene(blocks, side=side))
        centers.append([GOAL[0], ROBOT[:2], *(pose[:2] for pose in blocks.values())])
        sizes.append([GOAL[1], (0.4, 0.4), *(box_of(n, p) for n, p in blocks.items())])
    label = np.array([PALETTE_CLASSES.index(name) for name in OBJECTS], np.int32)
    tracks = Tracks(
        np.array(centers, np.float32),
        np.array(sizes, np.float32),
        label,
        np.ones((frames, len(label)), bool),
    )
    return np.stack(pictures), tracks


def save_demos(folder, names=("one", "two", "fell short"), source="drawn for a test"):
    """A demo set of three equal demonstrations, of which the last is a failure."""
    frames, tracks = moving_scene()
    outcomes = ["success"] * (len(names) - 1) + ["failure"]
    write_demo_set(
        folder,
        [Demo(n, frames, tracks, outcome=o) for n, o in zip(names, outcomes, strict=True)],
        task="match_regions",
        classes=PALETTE_CLASSES,
        half_extent=HALF_EXTENT,
        fps=8.0,
        source=source,
    )


def save_profiles(folder, names=("one", "two", "fell short"), **changes):
    """profiles.npz of one training, one validation and one failed demonstration."""
    reward = np.linspace([-1, -1, -1], [0, 0.02, -0.6], FRAMES, axis=1).astype(np.float32)
    transitions = np.zeros(reward.shape, bool)
    transitions[:, 4] = True
    arrays = {
        "names": np.array(names),
        "split": np.array(["train", "validation", "failure"]),
        "reward": reward,
        "length": np.array([FRAMES, FRAMES, FRAMES - 1], np.int32),
        "transitions": transitions,
    }
    np.savez(folder / "profiles.npz", **{**arrays, **changes})


def save_rollouts(folder, frames=FRAMES, **changes):
    """rollouts.npz of two episodes, and the video of the first."""
    write_video(folder / "rollout.mp4", moving_scene(frames)[0], 8.0)
    arrays = {
        "reward": np.linspace([-1, -1], [0, -0.5], FRAMES - 1, axis=1).astype(np.float32),
        "success": np.array([True, False]),
        "score": np.array([1.0, 0.5], np.float32),
        "shown": np.array([0, 1, 1]),
    }
    np.savez(folder / "rollouts.npz", **{**arrays, **changes})


def save_run(
    path,
    *,
    config=None,
    demos_path=None,
    results=RESULTS,
    pretrain=5,
    ppo=5,
    covered=False,
    **names,
):
    """A whole run's folder; `pretrain` and `ppo` are numbers of metric rows. Unless it is `covered`
    by digests, what is in it may be changed."""
    config = config or RunConfig()
    if demos_path is not None:
        config = dataclasses.replace(config, demos=DemosConfig(path=str(demos_path)))
    with run_dir.create(path, config, device="1 x cpu", command=["gril", "train", "x"]) as run:
        for i in range(1, pretrain + 1):
            parts = {"consistency": 1.5 / i, "reconstruction": 0.5 / i}
            run.log(phase="pretrain", step=i, loss=2 / i, **parts)
        for i in range(1, ppo + 1):
            run.log(phase="ppo", env_steps=1000 * i, success=i / 10, reward=-1 / i, episodes=3)
        if results is not None:
            run.finish(results)
    if demos_path is None:
        save_demos(path / "demos", **names)
    save_profiles(path, **names)
    if ppo:
        save_rollouts(path)
    return path if covered else uncovered(path)


def differing(one, other):
    """Files of two runs that differ or that only one of them has, but for the clocks."""
    names = {p.relative_to(run).as_posix() for run in (one, other) for p in run.rglob("*")}
    return sorted(
        name
        for name in names
        if name != "times.jsonl" and _contents(one / name) != _contents(other / name)
    )


def _contents(file):
    return file.read_bytes() if file.is_file() else file.is_dir()


def uncovered(path):
    """Makes a run forget its digests, so that its files may be changed; returns its folder."""
    write_phases(path, dataclasses.replace(read_phases(path), files={}, metrics=None))
    return path
