"""The reward in plain JAX: many rollouts at once, and a gradient.

python -m gril_jax.experiments.examples.plain_jax reward.npz

With the reward of `learn_reward`, robots that push end at about 0 and those that wander near -1.
"""

import sys
from collections.abc import Callable

import jax
import jax.numpy as jnp

from gril_jax.export.reward_file import load_reward

from . import pushing


def main(path: str, *, episodes: int = 64, echo: Callable[[str], None] = print) -> dict:
    """Returns the mean final rewards of robots that push and of robots that drive at random."""
    learned = load_reward(path)

    def rollout(key, actions):
        table = pushing.reset(key)
        memory = learned.init(*pushing.boxes(table))

        def frame(carry, action):
            table, memory = carry
            table = pushing.step(table, action)
            memory, reward = learned.step(memory, *pushing.boxes(table))
            return (table, memory), reward

        return jax.lax.scan(frame, (table, memory), actions)[1]

    keys = jax.random.split(jax.random.key(0), episodes)
    push = jnp.tile(jnp.array([1.0, 0.0]), (episodes, 23, 1))
    wander = jax.random.uniform(jax.random.key(1), push.shape, minval=-1.0)
    many = jax.jit(jax.vmap(rollout))
    final = {name: many(keys, x)[:, -1].mean() for name, x in (("push", push), ("wander", wander))}

    # Where should the block go? The reward's gradient by the objects' centres says so.
    center, size = pushing.boxes(pushing.reset(keys[0]))
    moved = jnp.array([False, True, True])
    uphill = jax.jit(jax.grad(learned))(center, size, moved)[2]
    found = {"push": float(final["push"]), "wander": float(final["wander"])}
    echo(f"final reward {found}; to the block, uphill is {uphill.tolist()}")
    return found | {"uphill": uphill.tolist()}


if __name__ == "__main__":
    main(sys.argv[1])
