"""Finds the stages of a task in the learned reward of a run: figures, scores, cut demonstrations.

    gril subtasks RUN                   about a minute
    gril subtasks RUN --videos          and each segment as a video of its own
    gril subtasks RUN --sets            and a set for each subtask, for `gril pretrain --demos`

`segments.csv` has a line a segment: its video, frames and seconds. A call may be repeated and
refined; its results take the place of the earlier ones.

Boundaries are those on which the successful demonstrations agree (`gril_jax.subtasks.agreement`);
where the set has stage times (`Demo.stages`), those of held-out demonstrations are scored.
Where held-out demonstrations by themselves disagree on how many stages there are, a sentence says
that the reward may not be fit for stages.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.figure import Figure

from gril_jax import reward
from gril_jax.config import RunConfig
from gril_jax.config.run_config import StageOptions
from gril_jax.demos import schema
from gril_jax.demos.demo import Demo
from gril_jax.demos.demo_set import DemoSet
from gril_jax.demos.formats import lerobot
from gril_jax.errors import ConfigError, RunError
from gril_jax.export.lerobot import annotate
from gril_jax.report.curves import reward_profile
from gril_jax.report.style import COLOURS, GREY, png, styled
from gril_jax.runs import places, run_dir
from gril_jax.runs.json_lines import plain
from gril_jax.runs.progress import Progress
from gril_jax.runs.reading import require_same_demos
from gril_jax.safe_files import file_name, write_whole
from gril_jax.subtasks import agreement

from ..build import demonstrations, learners, policy_setup, setup, vocabulary
from .doubts import Stages, doubt, of_demonstrations
from .ends import as_csv, of_video, scores, segments, write_sets, write_videos
from .folder import part_of, settle

_FIGURES = 3  # held-out demonstrations that are drawn
_KNOBS = ("prominence", "patience", "support")  # options that find more stages where they are lower


class Traces(NamedTuple):
    """Rewards of the successful demonstrations."""

    demos: Sequence[Demo]
    held_out: list[bool]
    reward: Float[np.ndarray, "B T"]
    length: Int[np.ndarray, "B"]


def main(
    folder: Path, out: Path, options: StageOptions, *, echo: Callable[[str], None] = print
) -> None:
    """Writes figures, scores and cut demonstrations into a folder, which may be that of an earlier
    call: what is made again takes its place.

    Raises RunError if there is no reward, or if there is no stage. Raises ConfigError if what is to
    be annotated is no LeRobot dataset.
    """
    told = None if options.demos is None else Path(options.demos)
    config = run_dir.read_config(folder, demos=told)
    dataset = None if options.lerobot is None else _dataset(Path(options.lerobot))
    with Progress() as progress:
        demos = _demos(config, folder, progress)
        phase = progress.phase("finding stages", total=len(demos.demo_set), unit="videos")
        traces = traces_of(config, folder, demos)
        found, alone, rule = discover(traces, options)
        phase.update(len(demos.demo_set))
        agreed = np.asarray(found.frames)[:, : int(np.sum(found.kept))]
        _require_stages(folder, rule, agreed.shape[1])
        tolerance = round(demos.demo_set.fps)  # one second, in frames
        measured = _scores(traces, {"agreed": agreed, "each alone": alone}, tolerance)
        doubtful = doubt(alone, traces.held_out, agreed.shape[1])
        about = {"rule": rule, "tolerance": tolerance, "doubt": doubtful}
        stages = stages_of(traces, found, alone, rule, demos.demo_set.fps)
        doubts = of_demonstrations(stages)
        about |= _json(traces, found, stages, doubts, measured)
        with run_dir.writing(out), part_of(out) as part:
            _write(part, about, traces, demos.demo_set, options, dataset, progress)
            now = {name: one["segments"] for name, one in about["demonstrations"].items()}
            settle(part, out, plain(now))
        if options.sets:
            write_sets(out, demos.demo_set, traces.demos, agreed, progress)
    for line in _sentences(found, measured, about["demonstrations"], out):
        echo(line)
    if doubtful:
        echo(doubtful)


def _write(
    out: Path,
    about: Mapping[str, Any],
    traces: Traces,
    demo_set: DemoSet,
    options: StageOptions,
    dataset: lerobot.Dataset | None,
    progress: Progress,
) -> None:
    """Writes everything but the sets of subtasks into a new folder."""
    found, fps = about["demonstrations"], demo_set.fps
    write_whole(out / "subtasks.json", json.dumps(plain(about), indent=1) + "\n")
    write_whole(out / "segments.csv", as_csv(found, demo_set))
    drawn = [i for i, held in enumerate(traces.held_out) if held][:_FIGURES]
    phase = progress.phase("drawing", total=len(drawn), unit="figures", compiles=False)
    for count, i in enumerate(drawn, 1):
        demo, own = traces.demos[i], traces.reward[i, : traces.length[i]]
        look = {"stages": demo.stages, "name": demo.name, "fps": fps}
        picture = png(stages_figure(own, np.array(found[demo.name]["ends"]), demo.frames, **look))
        (out / f"{file_name(demo.name)}.png").write_bytes(picture)
        phase.update(count)
    if options.videos:
        write_videos(out / "videos", found, demo_set, progress)
    if dataset is not None:
        seconds = {name: [end / fps for end in one["ends"]] for name, one in found.items()}
        names = [f"stage {number}" for number in range(1, len(about["level"]) + 1)]
        annotate(dataset, out / "lerobot", seconds, names)


def traces_of(config: RunConfig, folder: Path, demos: demonstrations.Demonstrations) -> Traces:
    """The run's reward along its successful demonstrations."""
    params = policy_setup.learned_reward(folder, config, vocabulary.of_run(config, folder))
    names = [*demos.names["train"], *demos.names["validation"]]
    learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
    latents = jnp.asarray(learner.latents(params.encoder, learner.films(names), hyper))
    shown = demos.demo_set.select(names)
    return Traces(
        shown,
        [name in demos.names["validation"] for name in names],
        np.asarray(reward.latent_reward(params, latents)),
        np.array([*map(len, shown)], np.int32),
    )


def discover(
    traces: Traces, options: StageOptions
) -> tuple[agreement.SharedBoundaries, Int[np.ndarray, "B M"], dict[str, Any]]:
    """Boundaries on which all demonstrations agree, those that each shows alone, and the rule."""
    given = jnp.asarray(traces.reward), jnp.asarray(traces.length)
    rule: dict[str, Any] = {"prominence": options.prominence, "smoothing": options.smoothing}
    support = {"support": options.support}
    if (patience := options.patience) is None:
        patience, found = _stages(*given, **rule, **support)
    else:
        found = _agreed(*given, **rule, **support, patience=patience)
    alone = _each_alone(*given, **rule, patience=int(patience))
    return jax.device_get(found), np.asarray(alone), rule | support | {"patience": int(patience)}


_stages = jax.jit(agreement.agreed_stages, static_argnames="smoothing")
_agreed = jax.jit(agreement.agreed_boundaries, static_argnames="smoothing")
_each_alone = jax.jit(agreement.each_alone, static_argnames="smoothing")


def _demos(config: RunConfig, folder: Path, progress: Progress) -> demonstrations.Demonstrations:
    source = Path(config.demos.path or folder / "demos")
    places.require(source, "the reward is to be followed along its videos")
    require_same_demos(folder, source / schema.HEADER)
    return demonstrations.gather(config, setup.task_of(config.env), folder / "demos", progress)


def _dataset(folder: Path) -> lerobot.Dataset:
    if not lerobot.is_dataset(folder):
        raise ConfigError(f"--lerobot is {folder}, but must be the folder of a LeRobot dataset")
    lerobot.parquet()  # before anything is computed
    return lerobot.opened(folder)


def _require_stages(folder: Path, rule: Mapping[str, Any], count: int) -> None:
    """Raises RunError if there is no boundary, with the options that find more."""
    if count < 1:
        options = ", ".join(f"--{name} (it was {rule[name]:g})" for name in _KNOBS)
        raise RunError(
            f"{folder}: the demonstrations agree on no end of a stage, but one is needed at "
            f"least: try a lower {options}"
        )


def _scores(
    traces: Traces, found: Mapping[str, Int[np.ndarray, "B M"]], tolerance: int
) -> dict[str, Any]:
    """Scores of held-out demonstrations with stage times; empty if there are none."""
    known = [i for i, e in enumerate(traces.demos) if traces.held_out[i] and e.stages]
    stages = [traces.demos[i].stages or {} for i in known]
    return {
        name: scores([frames[i] for i in known], stages, tolerance)
        for name, frames in (found.items() if known else ())
    }


def stages_of(traces: Traces, found, alone, rule: Mapping[str, Any], fps: float) -> Stages:
    """The stages of all demonstrations, as they are doubted."""
    kept = int(np.sum(found.kept))
    smooth = jax.vmap(lambda x: agreement.running_median(x, rule["smoothing"]))
    return Stages(
        np.asarray(smooth(jnp.asarray(traces.reward))), np.asarray(found.frames)[:, :kept],
        np.asarray(found.found)[:, :kept], alone, np.asarray(found.level)[:kept],
        rule["prominence"], fps,
    )  # fmt: skip


def _json(
    traces: Traces, found, made: Stages, doubts: Sequence[list[str]], measured: Mapping[str, Any]
) -> dict[str, Any]:
    """All results as JSON; `segments` are first and last frames of each subtask."""
    demos = {}
    for i, demo in enumerate(traces.demos):
        parts = segments(made.ends[i])
        demos[demo.name] = {
            "split": "validation" if traces.held_out[i] else "train",
            "ends": made.ends[i].tolist(),
            "found": made.found[i].tolist(),
            "segments": parts,
            "video_segments": [of_video(demo, part, made.fps) for part in parts],
            "doubts": doubts[i],
            "stages": demo.stages,
        }
    return {
        "scores": measured,
        "level": made.level.tolist(),
        "support": found.support[: len(made.level)].tolist(),
        "demonstrations": demos,
    }


@styled
def stages_figure(
    reward: Float[np.ndarray, "T"],
    ends: Int[np.ndarray, "K"],
    frames: UInt8[np.ndarray, "T H W 3"],
    *,
    stages: Mapping[str, int] | None = None,
    name: str = "",
    fps: float | None = None,
) -> Figure:
    """The profile with the frames at the found ends; true ends are dashed lines.

    The found ends are last frames of stages; true ones have names, and are -1 for never.
    """
    boundary = np.zeros(len(reward), bool)
    boundary[ends[(ends >= 0) & (ends < len(reward))]] = True
    figure = reward_profile(reward, boundary, frames=frames, name=name, fps=fps)
    axes = figure.axes[0]
    if stages:
        figure.text(
            0.988, 1 - 0.08 / figure.get_figheight(), "numbers: stages found; dashed: true ends",
            ha="right", va="top", fontsize=9, color=GREY,
        )  # fmt: skip
    for stage, frame in (stages or {}).items():
        if 0 <= frame < len(reward):
            axes.axvline(frame, color=COLOURS[2], linestyle="--", linewidth=1.2, zorder=1)
            axes.annotate(
                stage, (frame, 0), (-3, 5), xycoords=("data", "axes fraction"),
                textcoords="offset points", color=COLOURS[2], fontsize=9, ha="right",
            )  # fmt: skip
    return figure


def _sentences(
    found, measured: Mapping[str, Any], demos: Mapping[str, Any], out: Path
) -> Sequence[str]:
    levels = found.level[: int(np.sum(found.kept))].tolist()
    lines = [in_words(levels)]
    for name, one in measured.items():
        lines.append(
            f"held-out demonstrations ({name}): all stages found in {one['all_found']:.0%} of "
            f"{one['demonstrations']}, precision {one['precision']:.2f}, recall "
            f"{one['recall']:.2f}, median timing error {one['median_error']:.1f} frames, "
            f"{one['false']:.2f} false boundaries a demonstration, right number in "
            f"{one['right_count']:.0%}"
        )
    if not measured:
        lines.append("the demonstrations have no stage times, so the stages are not scored")
    lines += [
        f"doubtful: {name} {', '.join(one['doubts'])}"
        for name, one in demos.items()
        if one["doubts"]
    ]
    return [*lines, f"written to {out}"]


def in_words(levels: Sequence[float]) -> str:
    """The number of stages and their rewards; a single one is called what it is.

    >>> in_words([-0.5, 0.0])
    '2 stages, which end at rewards of -0.50, 0.00'
    """
    said = ", ".join(f"{x:.2f}" for x in levels)
    if len(levels) == 1:
        return f"1 stage, which ends at a reward of {said}: a one-stage task"
    return f"{len(levels)} stages, which end at rewards of {said}"
