"""Behaviour cloning on human demonstrations with their actions, a baseline that knows more: JSON.

    python -m gril_jax.experiments.suite.cloning recorded.json --sets SETS --out cloning.json

Rewards here are learned from films alone; this baseline is also given the recorded actions. They
are played in our simulator, and after each control step robot and blocks are put where the film has
them, so that replays do not drift; angles and speeds are the simulator's. A network of the
observation is trained to name the next of MAGICAL's 18 actions, and plays Demo and every variant.

Shapes use D for demonstrations, T for control steps, F for the pairs of observation and action, O
for an observation, K for seeds and E for episodes.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

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
from gril_jax.safe_files import write_whole

from ..fidelity.physics_parity import printed
from ..pipeline.policy_rewards import in_the_order_of
from . import variants
from .rows import TASKS, folder_of

_ACTIONS = 18


@dataclass(frozen=True)
class _Options:
    recorded: Annotated[Path, tyro.conf.Positional]
    """The recorded actions, a JSON file."""
    sets: Path
    """Folder of the tasks' demonstration sets."""
    out: Path
    """JSON file of the results."""
    tasks: tuple[str, ...] = TASKS
    """Tasks to learn."""
    seeds: int = 5
    """Networks of each task."""
    steps: int = 3000
    """Gradient steps."""
    starts: int = 64
    """Starts of each variant."""


class _Network(nn.Module):
    """Logits of the actions."""

    @nn.compact
    def __call__(self, x):
        for width in (256, 256):
            x = nn.relu(nn.Dense(width)(x))
        return nn.Dense(_ACTIONS)(x)


def pairs(
    env: Env, centers: list[Float[np.ndarray, "T N 2"]], actions: list[Int[np.ndarray, "T"]]
) -> tuple[Float[np.ndarray, "F O"], Int[np.ndarray, "F"]]:
    """Observations of each demonstration's frames, and the actions that followed them."""
    start = env.reset(jax.random.key(0))
    table = jnp.asarray(from_magical(np.arange(_ACTIONS)))

    def move(state, inputs):
        center, action = inputs
        state = env.shifted(state, center)
        return env.step(state, table[action]), state.obs

    length = max(map(len, actions))
    pad = lambda x: np.concatenate([x, np.repeat(x[-1:], length - len(x), axis=0)])  # noqa: E731
    inputs = tuple(jnp.asarray(np.stack([pad(x) for x in each])) for each in (centers, actions))
    seen = jax.jit(jax.vmap(lambda *x: jax.lax.scan(move, start, x)[1]))(*inputs)
    kept = [np.asarray(seen[i, : len(own)]) for i, own in enumerate(actions)]
    return np.concatenate(kept), np.concatenate(actions)


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
    table, network = jnp.asarray(from_magical(np.arange(_ACTIONS))), _Network()
    middle, spread = normal

    def one(params):
        def move(states, key):
            logits = network.apply(params, (states.obs - middle) / spread)
            chosen = jnp.argmax(logits, axis=-1)
            if sampled:
                chosen = jax.random.categorical(key, logits)
            return jax.vmap(env.step)(states, table[chosen]), None

        last, _ = jax.lax.scan(move, begun, jax.random.split(key, env.episode_length))
        return {name: last.metrics[name] for name in ("score", "success")}

    return jax.lax.map(one, params)


def measure(task: str, films: dict[str, list[int]], sets: Path, options: _Options) -> dict:
    """Scores of a task's cloned policies in all variants."""
    make = lambda variant: envs.make(task, variant=variant, padded=True)  # noqa: E731
    names = variants.known(task)
    each = {name: make(name) for name in names}
    env = each["demo"]
    found = load_demo_set(sets / task)
    seen = env.reset(jax.random.key(0)).objects
    label, there = np.asarray(seen.label), np.asarray(seen.size).any(axis=1)
    centers, actions = [], []
    for entry, tracks in zip(found.entries, found.tracks, strict=True):
        own = films[f"{folder_of(task)}/{_number(entry.name)}"]
        order = in_the_order_of(label[there], np.asarray(tracks.label))
        count = min(len(own), len(tracks.center))
        center = np.tile(np.asarray(seen.center), (count, 1, 1))  # of what is not there, too
        center[:, there] = tracks.center[:count, order]
        centers.append(center)
        actions.append(np.asarray(own[:count], np.int32))
    obs, chosen = pairs(env, centers, actions)
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


def _number(name: str) -> str:
    return name.rpartition("-")[2]


def main(argv: list[str] | None = None) -> int:
    """Writes the results after each task, and prints them."""
    options = tyro.cli(_Options, args=argv)

    def work() -> dict:
        whole = json.loads(options.recorded.read_text(encoding="utf-8"))
        films = {name: one["actions"] for name, one in whole.items()}
        found = {}
        for task in options.tasks:
            found[task] = measure(task, films, options.sets, options)
            write_whole(options.out, json.dumps(found, indent=1) + "\n")
        return found

    return printed("cloning", work)


if __name__ == "__main__":
    sys.exit(main())
