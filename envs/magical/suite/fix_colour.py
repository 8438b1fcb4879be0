"""FixColour: each region holds a block; push out the one that has not its region's colour.

Score 1 if each region has in it exactly its own block, and nothing if that has another colour than
the region; else 0. So the odd block must not come to rest in another region, nor may another block
stand in for one.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical import regions
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import NOTHING
from gril_jax.envs.stages import Stage, Stages
from jaxtyping import Array, Float

from .draws import colours, shapes
from .plan import Block, Kinds, Plan, Region, Scene
from .task import SuiteTask

_ODD = 2
# In MAGICAL's order of colours, of which the first three are drawn for the odd block.
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
        inside = regions.holds(scene.regions[:, None], scene.blocks) & scene.there
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
