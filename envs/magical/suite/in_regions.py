"""FindDupe, FixColour and MatchRegions: bring blocks into regions, or out of them.

FindDupe: the region holds a block; bring a second one of the same colour and shape. FixColour: each
region holds a block; push out the one that has not its region's colour. MatchRegions, with
MAGICAL's own draws: bring all blocks of the region's colour in, others out.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import NOTHING
from gril_jax.envs.stages import Stage, Stages
from jaxtyping import Array, Float

from .plan import Block, Kinds, Plan, Region, Scene, colours, in_region, in_region_stage, shapes
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
        inside = in_region(scene.regions[0], scene.blocks) & scene.there
        alike = (scene.colour == scene.colour[_QUERY]) & (scene.shape == scene.shape[_QUERY])
        n_t, n_d = (inside & alike).sum(), (inside & ~alike).sum()
        share = 1.0 - n_d / jnp.maximum(n_t + n_d, 1)
        return jnp.where(n_t >= 2, share, 0.0).astype(jnp.float32)

    def _stages(self) -> Stages:
        region, movable = self._order.region(0), tuple(range(2, 9))
        rows = {slot: self._order.block(slot) for slot in range(7)}
        made = {
            slot: in_region_stage(row, region, f"{self._called(slot)} in the region", movable)
            for slot, row in rows.items()
        }
        faults = [made[slot] for slot in range(_DUPE)]
        return self._staged([made[_QUERY], made[_DUPE]], movable, faults)

    def _called(self, slot: int) -> str:
        own = {_QUERY: "query", _DUPE: "duplicate"}
        return own.get(slot, f"{self.plan.blocks[slot].name} {slot + 1}")


_ODD = 2
# In MAGICAL's order of colours, of which the first three are sampled for the odd block.
_ORIGINAL = tuple(COLOURS.index(colour) for colour in ("red", "green", "blue", "yellow"))


class FixColour(SuiteTask):
    """The FixColour task; see the module docstring."""

    length = 60
    plan = Plan(
        (0.368, 0.586, 0.718),
        (
            Block("green pentagon", (0.289, 0.030, 0.307), home=0),
            Block("green square", (0.133, -0.561, 1.699), home=1),
            Block("blue pentagon", (-0.336, 0.000, -1.529), home=_ODD),
        ),
        (
            Region("green", -0.032, 0.348, 0.427, 0.468),
            Region("green", 0.019, -0.391, 0.460, 0.458),
            Region("red", -0.681, 0.196, 0.498, 0.418),
        ),
        sides=(0.4, 0.5),
        margin=0.12,
    )

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Regions of any colour, one of them with a block of another; in CountPlus 2 or 3."""
        count = 3
        if self.varies("count"):
            count = jax.random.randint(keys(), (), 2, 4)
            kinds = kinds._replace(region_there=jnp.arange(3) < count)
        if self.varies("color"):
            region = colours(keys(), 3)
            odd = jnp.arange(3) == jax.random.randint(keys(), (), 0, count)
            colour = jnp.where(odd, _other(keys(), region), region)
            kinds = kinds._replace(colour=colour, region_colour=region)
        if self.varies("shape"):
            kinds = kinds._replace(shape=shapes(keys(), 3))
        return kinds._replace(shape=jnp.where(kinds.region_there, kinds.shape, NOTHING))

    def score(self, scene: Scene) -> Float[Array, ""]:
        """1 if each region has in it exactly what belongs there."""
        inside = in_region(scene.regions[:, None], scene.blocks) & scene.there
        own = jnp.eye(3, dtype=bool) & (scene.colour == scene.region_colour)
        there = scene.regions[:, 2] > 0
        right = (inside == own).all(axis=1) | ~there
        return right.all().astype(jnp.float32)

    def _stages(self) -> Stages:
        places = [self._order.region(r) for r in range(3)]
        rows, movable = [self._order.block(b) for b in range(3)], tuple(range(4, 7))

        def inside(center, size, block, r):
            return (jnp.abs(center[block] - center[r]) <= size[r] / 2).all()

        def out(center, size):
            held = [inside(center, size, rows[_ODD], r) for r in places]
            return ~jnp.stack(held).any()

        def clear(center, size):
            """The odd block's box is out of all regions, not its centre alone."""
            away = [
                jnp.abs(center[rows[_ODD]] - center[r]) >= (size[rows[_ODD]] + size[r]) / 2
                for r in places
            ]
            return jnp.stack(away).any(axis=1).all()

        def astray(slot):
            block, home = rows[slot], places[slot]
            done = lambda c, s: ~inside(c, s, block, home)  # noqa: E731
            name = f"{self.plan.blocks[slot].name} out of its region"
            return Stage(name, (block,), done, self._scatter(block, done, movable))

        name = f"{self.plan.blocks[_ODD].name} out of the regions"
        stage = Stage(
            name, (rows[_ODD],), out, self._scatter(rows[_ODD], clear, movable),
            within=lambda center, size: (jnp.full(2, -self.arena), jnp.full(2, self.arena)),
        )  # fmt: skip
        return self._staged([stage], movable, [astray(0), astray(1)])


def _other(key, region):
    """A colour other than the regions', as skewed as MAGICAL draws it."""
    rank = jnp.argsort(jnp.array(_ORIGINAL))[region]
    drawn = jax.random.randint(key, (3,), 0, 3, jnp.int32)
    return jnp.array(_ORIGINAL, jnp.int32)[drawn + (drawn == rank)]


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
        inside = in_region(scene.regions[0], scene.blocks) & scene.there
        target = scene.there & (scene.colour == scene.region_colour[0])
        n_t, n_d = (inside & target).sum(), (inside & ~target).sum()
        share = n_t / jnp.maximum(target.sum(), 1)
        return (share * (1.0 - n_d / jnp.maximum(n_t + n_d, 1))).astype(jnp.float32)

    def _stages(self) -> Stages:
        region, blocks = self._order.region(0), len(self.plan.blocks)
        movable = tuple(range(2, 2 + blocks))
        made = [
            in_region_stage(self._order.block(slot), region, f"{block.name} in the region", movable)
            for slot, block in enumerate(self.plan.blocks)
        ]
        return self._staged(made[:_TARGETS], movable, made[_TARGETS:])


def _coloured(target):
    """The colour of each slot, given that of the targets."""
    others = jnp.where(_ORDER == target, 4, jnp.arange(4))
    others = jnp.asarray(_ORDER)[jnp.argsort(others)[:3]]  # the original's order, without it
    return jnp.where(jnp.arange(_MOST) < _TARGETS, target, others[_GROUP]).astype(jnp.int32)
