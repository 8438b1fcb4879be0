"""Human demonstrations with their actions, for baselines that are given these, too.

The recorded actions are played in our simulator, and after each control step robot and blocks are
put where the film has them, so that replays do not drift; angles and speeds are the simulator's.

Shapes use D for demonstrations, T for control steps, N for objects, F for pairs of observation and
action, O for an observation and A for an action.
"""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs import Env
from gril_jax.envs.magical.simulator import from_magical
from jaxtyping import Array, Float, Int

from gril_jax.demos.demo_set import load_demo_set
from gril_jax.errors import DemoError
from gril_jax.safe_files import write_whole
from gril_jax.workflows.build.policy_rewards import in_the_order_of

from ..fidelity import suite_replay
from ..fidelity.physics_parity import printed

NUM_ACTIONS = 18  # MAGICAL's


@dataclasses.dataclass(frozen=True)
class Options:
    """Options that these baselines share."""

    recorded: Annotated[Path, tyro.conf.Positional]
    """The recorded actions, a JSON file."""
    sets: Path
    """Folder of the tasks' demonstration sets."""
    out: Path
    """JSON file of the results."""
    tasks: tuple[str, ...] = suite_replay.TASKS
    """Tasks to learn."""
    seeds: int = 5
    """Policies of each task."""
    starts: int = 64
    """Starts of each variant that finished policies are evaluated from."""


def measured(
    name: str, options: Any, measure: Callable[[str, Int[np.ndarray, "D T"], Any], dict]
) -> int:
    """Writes the results of a baseline after each task, and prints them; the exit code."""

    def work() -> dict:
        found = {}
        for task, actions in suite_replay.load(options.recorded, options.tasks).items():
            found[task] = measure(task, actions, options)
            write_whole(options.out, json.dumps(found, indent=1) + "\n")
        return found

    return printed(name, work)


def table() -> Float[Array, "18 A"]:
    """MAGICAL's actions as ours, in their order."""
    return jnp.asarray(from_magical(np.arange(NUM_ACTIONS)))


def of_task(
    env: Env, recorded: Int[np.ndarray, "D T"], folder: Path
) -> tuple[Float[np.ndarray, "F O"], Int[np.ndarray, "F"]]:
    """`pairs` of all films of a demonstration set, whose actions come in the order of the films."""
    found = load_demo_set(folder)
    if len(found) != len(recorded):
        raise DemoError(
            f"{folder} has {len(found)} films, but there are recorded actions of {len(recorded)}"
        )
    seen = env.reset(jax.random.key(0)).objects
    label, there = np.asarray(seen.label), np.asarray(seen.size).any(axis=1)
    centers, actions = [], []
    for demo, own in zip(found, recorded, strict=True):
        tracks = demo.tracks
        order = in_the_order_of(label[there], np.asarray(tracks.label))
        count = min(len(own), len(tracks.center))
        center = np.tile(np.asarray(seen.center), (count, 1, 1))  # of what is not there, too
        center[:, there] = tracks.center[:count, order]
        centers.append(center)
        actions.append(np.asarray(own[:count], np.int32))
    return pairs(env, centers, actions)


def pairs(
    env: Env, centers: list[Float[np.ndarray, "_ N 2"]], actions: list[Int[np.ndarray, "_"]]
) -> tuple[Float[np.ndarray, "F O"], Int[np.ndarray, "F"]]:
    """Observations of each demonstration's frames, and the actions that followed them."""
    start, known = env.reset(jax.random.key(0)), table()

    def move(state, inputs):
        center, action = inputs
        state = env.shifted(state, center)
        return env.step(state, known[action]), state.obs

    length = max(map(len, actions))
    pad = lambda x: np.concatenate([x, np.repeat(x[-1:], length - len(x), axis=0)])  # noqa: E731
    inputs = tuple(jnp.asarray(np.stack([pad(x) for x in each])) for each in (centers, actions))
    seen = jax.jit(jax.vmap(lambda *x: jax.lax.scan(move, start, x)[1]))(*inputs)
    kept = [np.asarray(seen[i, : len(own)]) for i, own in enumerate(actions)]
    return np.concatenate(kept), np.concatenate(actions)
