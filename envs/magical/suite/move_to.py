"""MoveToCorner: push the one block into the top left corner. MoveToRegion: drive into the region.

MoveToCorner's score is min(1, max(0, sqrt 2 - d) / (sqrt 2 - sqrt 2 / 2)) with the distance d of
the block's centre to the corner.
"""

import math

import jax.numpy as jnp
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Float

from .plan import Block, Kinds, Plan, Region, Scene, colours, in_region, in_region_stage, shapes
from .task import SuiteTask

_FAR, _NEAR = math.sqrt(2.0), math.sqrt(0.5)


class MoveToCorner(SuiteTask):
    """The MoveToCorner task; see the module docstring."""

    length = 80
    plan = Plan((0.4, 0.0, 0.55 * math.pi), (Block("red square", (0.1, -0.65, 0.13 * math.pi)),))
    roles = ()
    variants = ("demo", "jitter", "color", "shape", "dynamics", "all")
    near, anywhere = ("jitter", "all"), ()  # MAGICAL's All has no full layout here
    robot_first = True

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Any colour, any shape."""
        if self.varies("color"):
            kinds = kinds._replace(colour=colours(keys(), 1))
        return kinds._replace(shape=shapes(keys(), 1)) if self.varies("shape") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """1 in the corner, 0 from its double distance on, linear between."""
        d = jnp.linalg.norm(scene.blocks[0] - self._corner())
        return jnp.clip((_FAR - d) / (_FAR - _NEAR), 0.0, 1.0)

    def _corner(self) -> Array:
        return jnp.array([-self.arena, self.arena])

    def _stages(self) -> Stages:
        block, corner = self._order.block(0), self._corner()

        def holds(center, size):
            return jnp.linalg.norm(center[block] - corner) <= _NEAR

        def within(center, size):
            return corner - jnp.array([0.0, _NEAR]), corner + jnp.array([_NEAR, 0.0])

        def place(key, center, size):
            margin = size[block] / 2
            low = corner + jnp.array([margin[0], -0.6])
            high = corner + jnp.array([0.6, -margin[1]])
            near = lambda c: jnp.linalg.norm(c[block] - corner) <= 0.6  # noqa: E731
            return free_place(
                key, block, center, size, low=low, high=high, others=(block,), allowed=near
            )

        stage = Stage("block in the corner", (block,), holds, place, within=within)
        return self._staged([stage], (block,))


class MoveToRegion(SuiteTask):
    """The MoveToRegion task; see the module docstring."""

    length = 40
    plan = Plan((0.058, 0.53, -2.13), (), (Region("blue", -0.62, -0.17, 0.76, 0.75),))
    roles = ()
    variants = ("demo", "jitter", "color", "layout", "dynamics", "all")

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """A region of any colour."""
        return kinds._replace(region_colour=colours(keys(), 1)) if self.varies("color") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """1 if the robot's centre is in the region."""
        return in_region(scene.regions[0], scene.robot).astype(jnp.float32)

    def _stages(self) -> Stages:
        stage = in_region_stage(0, self._order.region(0), "robot in the region", (0,))
        return Stages((stage,), (0,), self.arena, self.scored)
