"""Errors of MatchRegions against recordings of the original simulator, as JSON.

    python -m gril_jax.experiments.fidelity.physics_parity FILE.npz      # every robot in the file
    python -m gril_jax.experiments.fidelity.physics_parity FILE.npz --robot gripper

FILE holds, for each robot (gripper, short, medium, long), `<robot>_actions` (N, T, A) in [-1, 1],
`<robot>_states` (N, T + 1, bodies, 6) with x, y, angle, their rates (robot, fingers, star, square,
blue pentagon, yellow circle, yellow pentagon) and perhaps `<robot>_env_reward` (N, T), the S4
reward. "one_step" begins each control step in the recorded state, "open_loop" only the first.

Errors are distances in arena units and angles in rad: median, 95th percentile and count. "free" are
steps in which nothing touches the robot, "contact" those in which a block moves or the robot is at
a block or a wall.
"""

import json
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float

from gril_jax import envs
from gril_jax.errors import DemoError, GrilError
from gril_jax.workflows.build import setup

ROBOTS = ("gripper", "short", "medium", "long")
_MOVED = 1e-4  # arena units: a block that goes further in a control step has moved
_NEAR = 0.02  # arena units: a robot this near to a wall or a block may be touching it
_LANES = 400  # replayed at once


@dataclass(frozen=True)
class _Options:
    file: Annotated[Path, tyro.conf.Positional]
    """Recordings, an .npz file."""
    robot: Literal["gripper", "short", "medium", "long"] | None = None
    """Only this robot."""
    physics: Literal["xmagical", "magical"] = "xmagical"
    """Physics that replays them."""
    engine: Literal["auto", "kernel", "impulse", "mjx"] = "auto"
    """Solver that replays them."""
    substeps: int | None = None
    """Physics steps for each control step; None is the engine's default."""
    iterations: int | None = None
    """Sweeps of the contact solver for each physics step; None is the engine's default."""


def arrays_of(path: Path, contents: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz file; DemoError says what it should hold."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except FileNotFoundError:
        raise DemoError(f"{path} does not exist, but must be an .npz file of {contents}") from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise DemoError(f"{path} is not a whole .npz file of plain arrays ({error})") from error


def _load(path: Path, robot: str | None) -> dict[str, dict[str, np.ndarray]]:
    """Loads and checks the arrays of each robot in the file."""
    arrays = arrays_of(path, "recordings")
    wanted = [robot] if robot else [r for r in ROBOTS if f"{r}_states" in arrays]
    if not wanted:
        raise DemoError(f"{path} has no <robot>_states for any of {', '.join(ROBOTS)}")
    found = {}
    for name in wanted:
        for part in ("states", "actions"):
            if f"{name}_{part}" not in arrays:
                raise DemoError(f"{path} has no array {name}_{part}; it holds {', '.join(arrays)}")
        states = arrays[f"{name}_states"]
        bodies, size = (8, 3) if name == "gripper" else (6, 2)
        if states.ndim != 4 or states.shape[2:] != (bodies, 6) or states.shape[1] < 2:
            raise DemoError(
                f"{path}: {name}_states is {states.shape}, but must be (N, T + 1, {bodies}, 6)"
            )
        steps = (states.shape[0], states.shape[1] - 1)
        for part, fitting in (("actions", (*steps, size)), ("env_reward", steps)):
            shape = arrays[f"{name}_{part}"].shape if f"{name}_{part}" in arrays else fitting
            if shape != fitting:
                raise DemoError(
                    f"{path}: {name}_{part} is {shape}, but must be {fitting} to fit {name}_states"
                )
        rewards = arrays.get(f"{name}_env_reward")
        found[name] = {"states": states, "actions": arrays[f"{name}_actions"], "rewards": rewards}
    return found


def _one_step(env: envs.Env, states, actions):
    """Poses (N, T, E, 3) and rewards (N, T) one control step after each recorded state."""
    n, t = actions.shape[:2]
    parts = states.shape[2] - len(env.blocks)
    start = states[:, :1, parts : parts + env.num_targets, :2]
    start = np.broadcast_to(start, (n, t, *start.shape[2:]))
    # What brought the scene here; before the first action the robot stood still.
    before = np.concatenate([np.zeros_like(actions[:, :1]), actions[:, :-1]], axis=1)

    def one(args):
        state, action, before, start = args
        scene = env.reset_to(state[:, :3], state[:, 3:], start=start, action=before)
        scene = env.step(scene, action)
        return scene.data.pose, scene.reward

    flat = [states[:, :-1], actions, before, start]
    flat = [jnp.asarray(f.reshape(n * t, *f.shape[2:]), jnp.float32) for f in flat]
    poses, rewards = jax.jit(lambda x: jax.lax.map(one, x, batch_size=min(_LANES, n * t)))(flat)
    return np.asarray(poses).reshape(n, t, -1, 3), np.asarray(rewards).reshape(n, t)


def _open_loop(env: envs.Env, states, actions):
    """Poses (N, T, E, 3) of whole trajectories from the first recorded state."""

    def move(scene, action):
        scene = env.step(scene, action)
        return scene, (scene.data.pose, scene.reward)

    def play(state, actions):
        return jax.lax.scan(move, env.reset_to(state[:, :3], state[:, 3:]), actions)[1]

    given = (jnp.asarray(x, jnp.float32) for x in (states[:, 0], actions))
    poses, rewards = jax.jit(jax.vmap(play))(*given)
    return np.asarray(poses), np.asarray(rewards)


def figures_of(errors: np.ndarray) -> dict[str, float | int | None]:
    """Median, 95th percentile and count."""
    if not errors.size:
        return {"median": None, "p95": None, "count": 0}
    median, p95 = np.percentile(errors, [50, 95])
    return {"median": round(float(median), 5), "p95": round(float(p95), 5), "count": errors.size}


def _both(position: np.ndarray, angle: np.ndarray) -> dict:
    return {"position": figures_of(position), "angle": figures_of(angle)}


def _apart(ours: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances and angles between poses (..., 3)."""
    angle = ours[..., 2] - theirs[..., 2]
    angle = np.abs(np.arctan2(np.sin(angle), np.cos(angle)))
    return np.linalg.norm(ours[..., :2] - theirs[..., :2], axis=-1), angle


def _touching(env: envs.Env, states: np.ndarray) -> np.ndarray:
    """(N, T) True if the robot is at a wall or a block before or after a step."""
    gap = jax.jit(jax.vmap(jax.vmap(env.clearance)))(jnp.asarray(states[..., :3], jnp.float32))
    near = np.asarray(gap) < _NEAR
    return near[:, :-1] | near[:, 1:]


def _compare(env, poses, rewards, states, recorded) -> dict:
    parts = states.shape[2] - len(env.blocks)
    before, after = states[:, :-1, :, :3], states[:, 1:, :, :3]
    moved = np.linalg.norm(after[..., parts:, :2] - before[..., parts:, :2], axis=-1) > _MOVED
    contact = moved.any(axis=-1) | _touching(env, states)
    place, angle = _apart(poses, after)
    result: dict = {
        "robot_free": _both(place[~contact, 0], angle[~contact, 0]),
        "robot_contact": _both(place[contact, 0], angle[contact, 0]),
        "blocks_moved": _both(place[..., parts:][moved], angle[..., parts:][moved]),
        "blocks_still": {"position": figures_of(place[..., parts:][~moved])},
    }
    if recorded is not None:
        result["reward_within_0.05"] = round(float((np.abs(rewards - recorded) < 0.05).mean()), 4)
    return result


def measure(
    states: Float[np.ndarray, "N T1 E 6"],
    actions: Float[np.ndarray, "N T A"],
    rewards: Float[np.ndarray, "N T"] | None,
    **options,
) -> dict:
    """Errors of one robot's recordings; `options` make the task."""
    env = setup.build("match_regions", options)
    one_step = _compare(env, *_one_step(env, states, actions), states, rewards)
    poses, reward = _open_loop(env, states, actions)
    open_loop = _compare(env, poses, reward, states, rewards)
    parts = states.shape[2] - len(env.blocks)
    place, angle = _apart(poses, states[:, 1:, :, :3])
    free = np.cumsum(_touching(env, states), axis=1) == 0  # until the first contact
    last = np.maximum(free.sum(axis=1) - 1, 0)
    rows = np.flatnonzero(free[:, 0])
    open_loop["robot_at_the_end_of_free_driving"] = {
        **_both(place[rows, last[rows], 0], angle[rows, last[rows], 0]),
        "median_steps": int(np.median(last[rows] + 1)) if len(rows) else None,
    }
    open_loop["final_robot"] = _both(place[:, -1, 0], angle[:, -1, 0])
    open_loop["final_blocks"] = {"position": figures_of(place[:, -1, parts:])}
    return {"one_step": one_step, "open_loop": open_loop}


def printed(name: str, work: Callable[[], dict]) -> int:
    """Prints figures as JSON; 0, or 2 and a sentence if a file or an option is not right."""
    try:
        figures = work()
    except (GrilError, ValueError) as error:
        print(f"{name}: {str(error).rstrip('.')}.", file=sys.stderr)
        return 2
    print(json.dumps(figures, indent=2), file=sys.stdout)
    return 0


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of each robot in a file."""
    options = tyro.cli(_Options, args=argv)
    chosen = {k: getattr(options, k) for k in ("physics", "engine", "substeps", "iterations")}

    def work() -> dict:
        found = _load(options.file, options.robot)
        figures = {name: measure(**of, robot=name, **chosen) for name, of in found.items()}
        return {"file": options.file.name, "options": chosen, **figures}

    return printed("physics_parity", work)


if __name__ == "__main__":
    sys.exit(main())
