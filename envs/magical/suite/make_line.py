"""MakeLine: put all blocks on one straight line, at any place and angle.

For each pair of blocks take the line through both. Blocks within 0.18 of it, in the order along
it, are a run as long as neighbours are at most 0.42 apart. L is the longest run of all pairs, at
least 1. With n blocks and m = max(n - 2, 2) the score is max(0, L - m) / (n - m). A tight clump of
two by two is such a line, too: the rule is the original's.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.stages import Stage, Stages
from jaxtyping import Array, Bool, Float, Int

from .draws import colours, shapes
from .plan import Block, Kinds, Plan, Scene
from .task import SuiteTask

_ASIDE, _GAP = 0.18, 0.42  # 1.5 and 3.5 block sizes
_PITCH = 0.26  # between blocks that are put on a line


def longest(blocks: Float[Array, "B 2"], there: Bool[Array, "B"]) -> Int[Array, ""]:
    """The number of blocks on the longest line."""
    count = len(blocks)
    first, second = np.triu_indices(count, 1)
    along = blocks[second] - blocks[first]
    along = along / jnp.sqrt(jnp.sum(along**2, axis=1, keepdims=True) + 1e-12)
    way = blocks - blocks[first][:, None]  # (pairs, B, 2)
    reach = jnp.sum(way * along[:, None], axis=-1)
    aside = jnp.abs(way[..., 0] * along[:, None, 1] - way[..., 1] * along[:, None, 0])
    reach = jnp.sort(jnp.where((aside <= _ASIDE) & there, reach, jnp.inf), axis=1)
    run, best = jnp.isfinite(reach[:, 0]).astype(jnp.int32), jnp.ones((), jnp.int32)
    for k in range(1, count):
        here = jnp.isfinite(reach[:, k])
        linked = here & (jnp.where(here, reach[:, k], 0.0) - reach[:, k - 1] <= _GAP)
        run = jnp.where(linked, run + 1, here.astype(jnp.int32))
        best = jnp.maximum(best, jnp.max(jnp.where(there[first] & there[second], run, 1)))
    return best


class MakeLine(SuiteTask):
    """The MakeLine task; see the module docstring."""

    length = 180
    plan = Plan(
        (0.702, -0.255, 0.347),
        (
            Block("blue star", (0.790, -0.820, -0.721)),
            Block("yellow circle", (-0.177, 0.383, -1.733)),
            Block("red star", (-0.051, -0.128, 2.696)),
            Block("green pentagon", (-0.292, -0.745, -0.159)),
        ),
    )

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Any colours, any shapes; in CountPlus 3 or 4 blocks."""
        if self.varies("color"):
            kinds = kinds._replace(colour=colours(keys(), 4))
        if self.varies("shape"):
            kinds = kinds._replace(shape=shapes(keys(), 4))
        return kinds.first(jax.random.randint(keys(), (), 3, 5)) if self.varies("count") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """max(0, L - m) / (n - m)."""
        n = scene.there.sum()
        m = jnp.maximum(n - 2, 2)
        beyond = jnp.maximum(longest(scene.blocks, scene.there) - m, 0)
        return beyond / (n - m).astype(jnp.float32)

    def _stages(self) -> Stages:
        rows = tuple(range(1, 5))

        def holds(center, size):
            return longest(center[jnp.array(rows)], jnp.ones(4, bool)) == 4

        def place(key, center, size):
            key_place, key_angle, key_order = jax.random.split(key, 3)
            limit = self.arena - 1.5 * _PITCH - 0.16
            middle = jax.random.uniform(key_place, (2,), minval=-limit, maxval=limit)
            angle = jax.random.uniform(key_angle, (), maxval=jnp.pi)
            along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            order = jax.random.permutation(key_order, jnp.array(rows))
            steps = _PITCH * (jnp.arange(4) - 1.5)
            return center.at[order].set(middle + steps[:, None] * along)

        stage = Stage("all blocks in a line", rows, holds, place)
        return self._staged([stage], rows)
