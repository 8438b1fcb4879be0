"""MatchRegions with MAGICAL's own draws: bring all blocks of the region's colour in, others out.

With n_t of the t targets and n_d distractors in the region the score is
(n_t / t) (1 - n_d / (n_t + n_d)). `match_regions` is the task as x-magical has it, whose scenes
have five blocks and one region without a colour; here the region has its colour, and CountPlus and
All draw how many blocks there are.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical import regions
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import NOTHING
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Float

from .draws import colours, shapes
from .plan import Block, Kinds, Plan, Region, Scene
from .task import SuiteTask

_TARGETS = 2  # the first slots
_MOST = 8
# Distractors are in groups of a colour, in the original's order of colours without the targets';
# Demo has none of the first group, one of the second and two of the third.
_GROUP = np.array([0, 0, 1, 2, 2, 0, 0, 1])  # of each slot; nothing is said of the targets'
_NUMBER = np.array([0, 1, 0, 0, 1, 0, 1, 1])  # of each slot among the targets or in its group
_ORDER = np.array([COLOURS.index(name) for name in ("red", "green", "blue", "yellow")])


class MatchRegions(SuiteTask):
    """The MatchRegions task; see the module docstring."""

    length = 120
    plan = Plan(
        (-0.5, 0.1, -1.2 * np.pi),
        (
            Block("green star", (0.80, -0.70, 2.37)),
            Block("green square", (-0.68, 0.72, 1.28)),
            Block("blue pentagon", (-0.05, -0.20, -1.09)),
            Block("yellow circle", (-0.75, -0.55, 2.78)),
            Block("yellow pentagon", (0.30, -0.82, -1.15)),
        ),
        (Region("green", 0.1, 0.7, 0.7, 0.6),),
        slots=_MOST,
    )

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Any colour of the targets, which the region has, too; the others follow in order. In
        CountPlus one or two targets, and none to two distractors of each other colour."""
        slots, none = len(kinds.shape), kinds.shape == NOTHING
        is_target = np.arange(slots) < _TARGETS
        if self.varies("color"):
            target = colours(keys(), 1)[0]
            kinds = kinds._replace(colour=_coloured(target)[:slots], region_colour=target[None])
        if self.varies("shape"):
            kinds = kinds._replace(shape=jnp.where(none, NOTHING, shapes(keys(), slots)))
        if self.varies("count"):
            targets = jax.random.randint(keys(), (), 1, _TARGETS + 1)
            others = jax.random.randint(keys(), (3,), 0, 3)
            there = _NUMBER[:slots] < jnp.where(is_target, targets, others[_GROUP[:slots]])
            kinds = kinds._replace(shape=jnp.where(there, shapes(keys(), slots), NOTHING))
        return kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """(n_t / t) (1 - n_d / (n_t + n_d))."""
        inside = regions.holds(scene.regions[0], scene.blocks) & scene.there
        target = scene.there & (scene.colour == scene.region_colour[0])
        n_t, n_d = (inside & target).sum(), (inside & ~target).sum()
        share = n_t / jnp.maximum(target.sum(), 1)
        return (share * (1.0 - n_d / jnp.maximum(n_t + n_d, 1))).astype(jnp.float32)

    def _stages(self) -> Stages:
        region, blocks = self._order.region(0), len(self.plan.blocks)
        movable = tuple(range(2, 2 + blocks))
        made = [
            regions.inside(self._order.block(slot), region, f"{block.name} in the region", movable)
            for slot, block in enumerate(self.plan.blocks)
        ]
        return self._staged(made[:_TARGETS], movable, made[_TARGETS:])


def _coloured(target):
    """The colour of each slot, given that of the targets."""
    others = jnp.where(_ORDER == target, 4, jnp.arange(4))
    others = jnp.asarray(_ORDER)[jnp.argsort(others)[:3]]  # the original's order, without it
    return jnp.where(jnp.arange(_MOST) < _TARGETS, target, others[_GROUP]).astype(jnp.int32)
