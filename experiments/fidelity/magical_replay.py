"""Replays the actions of MAGICAL's human demonstrations in our physics, as JSON.

    python -m gril_jax.experiments.fidelity.magical_replay FOLDER      # 20 s on 2 cores
    python -m gril_jax.experiments.fidelity.magical_replay FOLDER --states replayed_states.npz

Each demonstration's actions are played open loop from the Demo start; all ended with score 1 when
recorded. Contacts amplify whatever differs: MAGICAL itself, started a millionth of a unit beside,
ends with other scores. So the replay is repeated from `--moved` starts in which the robot stands
about 1e-5 units away, and `strayed` sets the distance of ours from the recordings beside that of
ours from itself. Where the first is the larger, our contacts are to blame and not the start.

STATES holds for each demonstration, under the last part of its file's name (`000`), the poses
(T + 1, 6, 3) of robot, star, square, blue pentagon, yellow circle and yellow pentagon. Errors are
distances to them in arena units, "blocks" those of blocks that have been moved by then.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs.magical.simulator import from_magical
from jaxtyping import Float, Int

from gril_jax import envs
from gril_jax.demos.magical_pickles import list_magical, read_actions
from gril_jax.errors import DemoError

from .physics_parity import arrays_of, figures_of, printed

_AHEAD = (10, 20, 40, 120)  # control steps from the start over which errors are taken
ASIDE = 1e-5  # arena units: standard deviation of a moved start
_MOVED = 0.01  # arena units: a block this far from its start has been moved


@dataclass(frozen=True)
class _Options:
    demos: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of *.pkl.gz files, or the files themselves."""
    states: Path | None = None
    """Recorded poses to compare with, an .npz file."""
    substeps: int | None = None
    """Physics steps for each control step; None is the engine's default, 10."""
    iterations: int | None = None
    """Sweeps of the solver for each physics step; None is the engine's default, 6."""
    moved: int = 8
    """Number of further replays, from starts near the true one."""


def _load(paths: tuple[Path, ...]) -> dict[str, Int[np.ndarray, "T"]]:
    """Actions of each demonstration, all of one length: `000` of demo-...-v0-000.pkl.gz."""
    files = [f for path in paths for f in (list_magical(path) if path.is_dir() else [path])]
    if not files:
        raise DemoError("no demonstration is named, but at least one folder or file must be")
    names = [file.name.removesuffix(".pkl.gz").rpartition("-")[2] for file in files]
    found = {name: read_actions(file) for name, file in zip(names, files, strict=True)}
    if len({len(actions) for actions in found.values()}) > 1:
        lengths = ", ".join(f"{name}: {len(actions)}" for name, actions in found.items())
        raise DemoError(f"demonstrations differ in length ({lengths}), but must be equally long")
    return found


def _recorded(path: Path, actions: dict[str, np.ndarray]) -> Float[np.ndarray, "D T1 6 3"]:
    arrays = arrays_of(path, "poses")
    for name, own in actions.items():
        if name not in arrays:
            raise DemoError(f"{path} has no poses of the demonstration {name}")
        found, shape = arrays[name].shape, (len(own) + 1, 6, 3)
        if found != shape:
            raise DemoError(f"{path}: {name} is {found}, but must be {shape}")
    return np.stack([arrays[name] for name in actions]).astype(np.float32)


def replay(env: envs.Env, actions: Float[np.ndarray, "D T 3"], aside: Float[np.ndarray, "K 2"]):
    """Positions (K, D, T, 6, 2) of robot and blocks, and final scores (K, D)."""
    parts = len(env.robot.parts)
    start = env.reset(jax.random.key(0))

    def move(state, action):
        state = env.step(state, action)
        place = jnp.concatenate([state.data.pose[:1], state.data.pose[parts:]])[:, :2]
        return state, (place, state.metrics["score"])

    def play(aside, actions):
        pose = start.data.pose.at[:parts, :2].add(aside)
        state = start._replace(data=start.data._replace(pose=pose))
        places, scores = jax.lax.scan(move, state, actions)[1]
        return places, scores[-1]

    over = jax.vmap(jax.vmap(play, (None, 0)), (0, None))
    places, scores = jax.jit(over)(jnp.asarray(aside, jnp.float32), jnp.asarray(actions))
    return np.asarray(places), np.asarray(scores)


def _errors(places: np.ndarray, recorded: np.ndarray) -> dict:
    """Errors of replays (D, T, 6, 2) against recorded poses, over the first steps."""
    theirs = recorded[:, 1:, :, :2]
    apart = np.linalg.norm(places - theirs, axis=-1)
    moved = np.linalg.norm(theirs - recorded[:, :1, :, :2], axis=-1) > _MOVED
    return {
        f"first_{n}": {
            "robot": figures_of(apart[:, :n, 0]),
            "blocks": figures_of(apart[:, :n, 1:][moved[:, :n, 1:]]),
        }
        for n in _AHEAD
        if n <= places.shape[1]
    }


def _strayed(places: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Mean distance of all blocks (..., T, 6, 2) from where they are in the reference, by step."""
    apart = np.linalg.norm(places - reference, axis=-1)[..., 1:]
    steps = [n for n in _AHEAD if n <= apart.shape[-2]]
    return {f"after_{n}": round(float(apart[..., n - 1, :].mean()), 5) for n in steps}


def measure(
    actions: dict[str, Int[np.ndarray, "T"]],
    recorded: Float[np.ndarray, "D T1 6 3"] | None = None,
    *,
    moved: int = 8,
    **options,
) -> dict:
    """Scores of replayed actions by demonstration, and their distance from recorded poses."""
    env = envs.make("match_regions", physics="magical", **options)
    ids = np.stack([*actions.values()])
    aside = np.random.default_rng(0).normal(scale=ASIDE, size=(1 + moved, 2))
    aside[0] = 0.0
    places, scores = replay(env, from_magical(ids), aside)
    won = (scores > 0.999).sum(axis=1)
    result = {
        "demonstrations": len(ids),
        "score_1": int(won[0]),
        "mean_score": round(float(scores[0].mean()), 4),
        "scores": {n: round(float(s), 4) for n, s in zip(actions, scores[0], strict=True)},
    }
    if moved:
        mean = round(float(scores[1:].mean()), 4)
        strayed = _strayed(places[1:], places[0])
        ended = {"score_1": won[1:].tolist(), "mean_score": mean}
        result["moved_starts"] = ended | {"strayed": strayed}
    if recorded is not None:
        strayed = {"strayed": _strayed(places[0], recorded[:, 1:, :, :2])}
        result["errors"] = _errors(places[0], recorded) | strayed
    return result


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of some demonstrations."""
    options = tyro.cli(_Options, args=argv)
    solver = {"substeps": options.substeps, "iterations": options.iterations}

    def work() -> dict:
        if options.moved < 0:
            raise ValueError(f"moved is {options.moved}, but must be at least 0")
        actions = _load(options.demos)
        recorded = None if options.states is None else _recorded(options.states, actions)
        return {"options": solver, **measure(actions, recorded, moved=options.moved, **solver)}

    return printed("magical_replay", work)


if __name__ == "__main__":
    sys.exit(main())
