"""Behaviour cloning on human demonstrations with their actions, a baseline that knows more: JSON.

    python -m gril_jax.experiments.baselines.cloning recorded.json --sets SETS --out cloning.json

Rewards here are learned from films alone; this baseline is also given the recorded actions
(`recorded.py`). A network of the observation is trained to name the next
of MAGICAL's 18 actions, and plays Demo and every variant.

Shapes use D for demonstrations, T for control steps, K for seeds and E for episodes.
"""

import sys
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optax
import tyro
from flax import linen as nn
from gril_jax.envs import Env
from gril_jax.experiments.baselines import recorded
from jaxtyping import Array, Float, Int

from gril_jax import envs
from gril_jax.workflows.study import variants


@dataclass(frozen=True)
class _Options(recorded.Options):
    steps: int = 3000
    """Gradient steps."""


class _Network(nn.Module):
    """Logits of the actions."""

    @nn.compact
    def __call__(self, x):
        for width in (256, 256):
            x = nn.relu(nn.Dense(width)(x))
        return nn.Dense(recorded.NUM_ACTIONS)(x)


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
    table, network = recorded.table(), _Network()
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


def measure(task: str, actions: Int[np.ndarray, "D T"], options: _Options) -> dict:
    """Scores of a task's cloned policies in all variants."""
    make = lambda variant: envs.make(task, variant=variant, padded=True)  # noqa: E731
    names = variants.known(task)
    each = {name: make(name) for name in names}
    obs, chosen = recorded.of_task(each["demo"], actions, options.sets / task)
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
    return recorded.measured("cloning", tyro.cli(_Options, args=argv), measure)


if __name__ == "__main__":
    sys.exit(main())
