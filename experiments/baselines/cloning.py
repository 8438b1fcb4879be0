"""Behaviour cloning on human demonstrations with their actions, a baseline that knows more: JSON.

    python -m gril_jax.experiments.baselines.cloning recorded.json --sets SETS --out cloning.json

Rewards here are learned from videos alone; baselines are also given the recorded actions. They are
played in our simulator, and after each control step robot and blocks are put where the video has
them, so that replays do not drift; a network is trained to name the next of MAGICAL's 18 actions.

Shapes use D for demonstrations, T for control steps, N for objects, F for pairs of observation and
action, O for an observation, A for an action, K for seeds and E for episodes.
"""

import dataclasses
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import tyro
from flax import linen as nn
from gril_jax.envs import Env
from gril_jax.envs.magical.simulator import from_magical
from jaxtyping import Array, Float, Int

from gril_jax import envs
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.errors import DemoError
from gril_jax.safe_files import write_whole
from gril_jax.workflows.build.policy_rewards import in_the_order_of
from gril_jax.workflows.study import variants

from ..fidelity import replay
from ..fidelity.physics_parity import printed

NUM_ACTIONS = 18  # MAGICAL's


@dataclasses.dataclass(frozen=True)
class RecordedOptions:
    """Options that these baselines share."""

    recorded: Annotated[Path, tyro.conf.Positional]
    """The recorded actions: a JSON file, or MatchRegions' folder of *.pkl.gz files."""
    sets: Path
    """Folder of the tasks' demonstration sets."""
    out: Path
    """JSON file of the results."""
    tasks: tuple[str, ...] = replay.TASKS
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
        for task, actions in replay.load(options.recorded, options.tasks).items():
            found[task] = measure(task, np.stack([*actions.values()]), options)
            write_whole(options.out, json.dumps(found, indent=1) + "\n")
        return found

    return printed(name, work)


def table() -> Float[Array, "18 A"]:
    """MAGICAL's actions as ours, in their order."""
    return jnp.asarray(from_magical(np.arange(NUM_ACTIONS)))


def of_task(
    env: Env, recorded: Int[np.ndarray, "D T"], folder: Path
) -> tuple[Float[np.ndarray, "F O"], Int[np.ndarray, "F"]]:
    """`pairs` of all videos of a demonstration set; actions come in the order of the videos."""
    found = load_demo_set(folder)
    if len(found) != len(recorded):
        raise DemoError(
            f"{folder} has {len(found)} videos, but there are recorded actions of {len(recorded)}"
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


@dataclass(frozen=True)
class _Options(RecordedOptions):
    steps: int = 3000
    """Gradient steps."""


class _Network(nn.Module):
    """Logits of the actions."""

    @nn.compact
    def __call__(self, x):
        for width in (256, 256):
            x = nn.relu(nn.Dense(width)(x))
        return nn.Dense(NUM_ACTIONS)(x)


def train(obs, actions, *, seeds: int, steps: int):
    """Parameters (K, ...) of networks that were trained on all pairs, and the normalisation."""
    middle, spread = obs.mean(axis=0), obs.std(axis=0) + 1e-3
    x, y = jnp.asarray((obs - middle) / spread), jnp.asarray(actions)
    network = _Network()
    rule = optax.adamw(optax.cosine_decay_schedule(1e-3, steps), weight_decay=1e-3)

    def one(key):
        params = network.init(key, x[0])

        def update(carry, key):
            params, moments = carry
            at = jax.random.randint(key, (512,), 0, len(x))

            def loss(params):
                logits = network.apply(params, x[at])
                return optax.softmax_cross_entropy_with_integer_labels(logits, y[at]).mean()

            change, moments = rule.update(jax.grad(loss)(params), moments, params)
            return (optax.apply_updates(params, change), moments), None

        keys = jax.random.split(key, steps)
        return jax.lax.scan(update, (params, rule.init(params)), keys)[0][0]

    params = jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(0), seeds))
    return params, (jnp.asarray(middle), jnp.asarray(spread))


def play(env: Env, params, normal, begun, key, *, sampled: bool) -> dict[str, Float[Array, "K E"]]:
    """Score and success at the end of each network's episodes."""
    known, network = table(), _Network()
    middle, spread = normal

    def one(params):
        def move(states, key):
            logits = network.apply(params, (states.obs - middle) / spread)
            chosen = jnp.argmax(logits, axis=-1)
            if sampled:
                chosen = jax.random.categorical(key, logits)
            return jax.vmap(env.step)(states, known[chosen]), None

        last, _ = jax.lax.scan(move, begun, jax.random.split(key, env.episode_length))
        return {name: last.metrics[name] for name in ("score", "success")}

    return jax.lax.map(one, params)


def measure(task: str, actions: Int[np.ndarray, "D T"], options: _Options) -> dict:
    """Scores of a task's cloned policies in all variants."""
    make = lambda variant: envs.make(task, variant=variant, padded=True)  # noqa: E731
    names = variants.known(task)
    each = {name: make(name) for name in names}
    obs, chosen = of_task(each["demo"], actions, options.sets / task)
    params, normal = train(obs, chosen, seeds=options.seeds, steps=options.steps)
    keys = jax.random.split(jax.random.key(1), options.starts)
    begun = [jax.jit(jax.vmap(each[name].reset))(keys) for name in names]
    begun = jax.tree.map(lambda *x: jnp.concatenate(x), *begun)
    results: dict = {"pairs": len(chosen)}
    for kind, sampled in (("deterministic", False), ("sampled", True)):
        run = jax.jit(lambda p, b, k, s=sampled: play(each["all"], p, normal, b, k, sampled=s))
        ended = run(params, begun, jax.random.key(2))
        for what, values in ended.items():
            parts = np.asarray(values).reshape(options.seeds, len(names), options.starts)
            for i, name in enumerate(names):
                results[f"{what}_{name}_{kind}"] = parts[:, i].mean(axis=1).round(4).tolist()
    return results


def main(argv: list[str] | None = None) -> int:
    """Writes the results after each task, and prints them."""
    return measured("cloning", tyro.cli(_Options, args=argv), measure)


if __name__ == "__main__":
    sys.exit(main())
