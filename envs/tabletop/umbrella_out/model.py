"""The scene of umbrella out: a square stand, and a folded umbrella that leans in it.

The stand is a mocap body with its origin on the table below its middle. The umbrella's origin is
its tip, its axis is z, and a block takes the place of the crook. Lengths are metres.
"""

from gril_jax.envs.panda.model import PADS, TIPS
from gril_jax.envs.tabletop import mjcf
from gril_jax.envs.tabletop.physics import TABLE, Additions

RIM = 0.2  # height of the stand
INSIDE = (0.041, 0.041)  # half its space
STAND_HALF = mjcf.outside(INSIDE, RIM)
LENGTH = 0.265  # of the umbrella
UMBRELLA_HALF = (0.013, 0.013, LENGTH / 2)
GRIP = (0.0, 0.0, 0.235)  # the middle of the block, from the tip
TIP, LEAN = -0.028, 0.2618  # the tip's place from the stand's middle; rad, towards the other wall

_WALLS = mjcf.walls("stand", INSIDE, RIM)


def _rod(name: str, radius: float, low: float, high: float, mass: float) -> str:
    ends = f'fromto="0 0 {low + radius} 0 0 {high - radius}"'
    return f'<geom name="{name}" type="capsule" size="{radius}" {ends} mass="{mass}"/>'


def scene() -> Additions:
    """The scene; the joint after the arm's is the umbrella's free one."""
    umbrella = mjcf.loose(
        "umbrella", _rod("canopy", 0.013, 0.0, 0.178, 0.1), _rod("shaft", 0.005, 0.15, 0.215, 0.01),
        mjcf.box("crook", GRIP, (0.012, 0.012, 0.03), 0.03),
        mjcf.box("", (0.0, 0.0, 0.165), (0.013, 0.013, 0.008)),  # the strap, painted alone
    )  # fmt: skip
    stand = mjcf.fixed("stand", *(mjcf.box(name, *shape) for name, shape in _WALLS.items()))
    pairs = [("canopy", TABLE), ("crook", TABLE), *(("crook", pad) for pad in PADS)]
    pairs += [(part, wall) for part in ("canopy", "shaft", "crook") for wall in _WALLS]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, *_WALLS, "canopy")]
    return Additions(stand + umbrella, tuple(pairs))
