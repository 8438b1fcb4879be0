"""MoveToRegion: drive the robot itself into the region, and stay.

Score 1 if the robot's centre is in the region, else 0. There are no blocks.
"""

import jax.numpy as jnp
from gril_jax.envs.magical import regions
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Float

from .draws import colours
from .plan import Kinds, Plan, Region, Scene
from .task import SuiteTask


class MoveToRegion(SuiteTask):
    """The MoveToRegion task; see the module docstring."""

    length = 40
    plan = Plan((0.058, 0.53, -2.13), (), (Region("blue", -0.62, -0.17, 0.76, 0.75),))
    variants = ("demo", "jitter", "color", "layout", "dynamics", "all")

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """A region of any colour."""
        return kinds._replace(region_colour=colours(keys(), 1)) if self.varies("color") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """1 if the robot's centre is in the region."""
        return regions.holds(scene.regions[0], scene.robot).astype(jnp.float32)

    def _stages(self) -> Stages:
        stage = regions.inside(0, self._order.region(0), "robot in the region", (0,))
        return Stages((stage,), (0,), self.arena, self.scored)
