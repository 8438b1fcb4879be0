"""FindDupe: the region holds a block; bring a second one of the same colour and shape.

Targets are the block inside (the query) and all of exactly its colour and shape, the rest are
distractors. With n_t targets and n_d distractors in the region the score is
[n_t >= 2] (1 - n_d / (n_t + n_d)).
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical import regions
from gril_jax.envs.planar.shapes import NOTHING
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Float

from .draws import colours, shapes
from .plan import Block, Kinds, Plan, Region, Scene
from .task import SuiteTask

_DUPE, _QUERY = 5, 6


class FindDupe(SuiteTask):
    """The FindDupe task; see the module docstring."""

    length = 100
    plan = Plan(
        (-0.57, 0.25, 3.83),
        (
            Block("green pentagon", (-0.066751, 0.7552, -2.9266)),
            Block("red circle", (-0.05195, 0.31468, 1.5418)),
            Block("red circle", (0.57528, -0.46865, -2.2141)),
            Block("yellow square", (0.40594, -0.74977, 0.24582)),
            Block("blue star", (0.45254, 0.3681, -1.0834)),
            Block("yellow pentagon", (0.76849, -0.10652, 0.10028)),
            Block("yellow pentagon", (-0.33, -0.49, -0.51), home=0),
        ),
        (Region("yellow", -0.72, -0.22, 0.67, 0.72),),
        margin=0.06,
    )

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Any query, its duplicate alike; the others independent, in CountPlus 1 to 5 of them."""
        if self.varies("color"):
            colour = colours(keys(), 7)
            colour = colour.at[_DUPE].set(colour[_QUERY])
            kinds = kinds._replace(colour=colour, region_colour=colour[_QUERY:])
        if self.varies("shape"):
            shape = shapes(keys(), 7)
            kinds = kinds._replace(shape=shape.at[_DUPE].set(shape[_QUERY]))
        if self.varies("count"):
            count = jax.random.randint(keys(), (), 1, 6)
            there = (jnp.arange(7) < count) | (jnp.arange(7) >= _DUPE)
            kinds = kinds._replace(shape=jnp.where(there, kinds.shape, NOTHING))
        return kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """[n_t >= 2] (1 - n_d / (n_t + n_d))."""
        inside = regions.holds(scene.regions[0], scene.blocks) & scene.there
        alike = (scene.colour == scene.colour[_QUERY]) & (scene.shape == scene.shape[_QUERY])
        n_t, n_d = (inside & alike).sum(), (inside & ~alike).sum()
        share = 1.0 - n_d / jnp.maximum(n_t + n_d, 1)
        return jnp.where(n_t >= 2, share, 0.0).astype(jnp.float32)

    def _stages(self) -> Stages:
        region, movable = self._order.region(0), tuple(range(2, 9))
        rows = {slot: self._order.block(slot) for slot in range(7)}
        made = {
            slot: regions.inside(row, region, f"{self._called(slot)} in the region", movable)
            for slot, row in rows.items()
        }
        faults = [made[slot] for slot in range(_DUPE)]
        return self._staged([made[_QUERY], made[_DUPE]], movable, faults)

    def _called(self, slot: int) -> str:
        own = {_QUERY: "query", _DUPE: "duplicate"}
        return own.get(slot, f"{self.plan.blocks[slot].name} {slot + 1}")
