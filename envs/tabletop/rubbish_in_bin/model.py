"""The scene of rubbish in the bin: a basket of wire, a crumpled box, and two tomatoes.

The bin is a mocap body with its origin on the table below its middle; it is square, as MJX has no
hollow cylinder. Tomatoes are spheres whose joints are damped, so that they roll to a stop. Lengths
are metres.
"""

from gril_jax.envs.panda.model import PADS, TIPS
from gril_jax.envs.tabletop import mjcf
from gril_jax.envs.tabletop.physics import TABLE, Additions

HEIGHT = 0.19  # of the bin
INSIDE = (0.081, 0.081)  # half its space
BIN_HALF = mjcf.outside(INSIDE, HEIGHT)
RUBBISH_HALF = (0.025, 0.02, 0.018)
RADIUS = 0.03  # of a tomato

_WALLS = mjcf.walls("bin", INSIDE, HEIGHT)
_TOMATOES = ("tomato_a", "tomato_b")


def _pairs() -> tuple[tuple[str, str], ...]:
    things = ("rubbish", *_TOMATOES)
    pairs = [(thing, other) for thing in things for other in (TABLE, *PADS, *_WALLS)]
    pairs += [("rubbish", tomato) for tomato in _TOMATOES]
    return (*pairs, _TOMATOES, *((tip, other) for tip in TIPS for other in (TABLE, *_WALLS)))


def scene() -> Additions:
    """The scene; joints after the arm's are one free joint each for rubbish and tomatoes."""
    shapes = (mjcf.box(name, *shape, more=mjcf.HIDDEN) for name, shape in _WALLS.items())
    basket = mjcf.fixed("bin", *shapes, mjcf.wires(INSIDE, HEIGHT))
    rubbish = mjcf.loose("rubbish", mjcf.box("rubbish", (0, 0, 0), RUBBISH_HALF, 0.05))
    tomatoes = "".join(
        mjcf.loose(
            name, f'<geom name="{name}" size="{RADIUS}" mass="0.1"/>', joint='damping="3e-4"'
        )
        for name in _TOMATOES
    )
    return Additions(basket + rubbish + tomatoes, _pairs())
