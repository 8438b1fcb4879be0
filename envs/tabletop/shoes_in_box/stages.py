"""The stages of shoes in the box as seen in a picture: boxes alone, no depth and no grip.

Objects are left finger, right finger, hand, box, lid, shoe A, shoe B; lengths are those of the
picture. Places are told in sizes of the box, from its middle. How the lid's box changes while it
opens is a curve through the camera's views of the hinge's angles, means over 256 starts. A start
turns the box by up to 22.5 degrees: then its own curve is up to an eighth of the box aside, and the
open lid's sizes are another ninth more or less in the median.

A lid elsewhere, which its hinge forbids, counts as open or closed by the curve's nearest point.
What a picture cannot tell: a shoe that is held above the box, or lies on its closed lid, from one
that lies in it, and a lid that was closed again over both shoes, which is a success for the task,
from one that was never opened. So true progress here is the share of stages that hold, each by
itself; the lid comes first in the order in which they are done.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.stages import Stage, Stages
from gril_jax.envs.tabletop import sight
from gril_jax.envs.tabletop.sight import ROBOTS, Area, placed, relative, share_that_holds
from jaxtyping import Array, Bool, Float, PRNGKeyArray

BOX, LID, SHOES = 3, 4, (5, 6)

# Angle of the hinge, rad; middle of the lid's box, in sizes of the box; its width and height, as
# shares of those when it is closed. Up to 0.1 rad a box changes less than a layout varies.
LID_CURVE = (
    (0.0, (0.054, 0.161), (1.0, 1.0)), (0.1, (0.053, 0.192), (1.0, 1.0)),
    (0.4, (0.025, 0.288), (0.959, 1.192)), (0.8, (-0.078, 0.396), (0.780, 1.486)),
    (1.2, (-0.241, 0.471), (0.484, 1.686)), (1.571, (-0.444, 0.495), (0.355, 1.746)),
    (2.0, (-0.658, 0.463), (0.748, 1.665)), (2.3, (-0.772, 0.406), (0.951, 1.514)),
    (2.6, (-0.840, 0.329), (1.070, 1.305)),
)  # fmt: skip
_OPEN = 1.571  # rad
_AT_REST, _ASIDE = (2.4, 2.6), 0.05  # where an open lid lies, rad, and how exactly
_GUIDED = (0.125, 0.125)  # how far a start's own curve is aside of the mean one
# Middles of shoes on the box's floor: where they count, and where they clearly do.
_INSIDE = Area((-0.32, -0.30), (0.32, 0.20))
_CLEARLY = Area((-0.22, -0.20), (0.22, 0.10))


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages of the task in a picture |x|, |y| <= `half_extent`; `things` name the objects."""
    return of_shoes(things, "in", _INSIDE, _CLEARLY, half_extent=half_extent)


def of_shoes(
    things: tuple[str, ...], where: str, area: Area, clearly: Area, *, half_extent: float
) -> Stages:
    """The stages of a task that opens the lid and brings both shoes into an area."""
    lid = Stage(f"{things[LID]} open", (LID,), _lid_open, _open_lid)
    shoes = (
        placed(f"{things[i]} {where}", i, BOX, area, clearly, others=SHOES, after=(lid.name,))
        for i in SHOES
    )
    return Stages(
        (lid, *shoes), movable=(LID, *SHOES), robots=ROBOTS, half_extent=half_extent,
        score=share_that_holds, sizes=_sizes,
        possible=sight.on_rail(LID, BOX, [middle for _, middle, _ in LID_CURVE], _GUIDED),
    )  # fmt: skip


def _curve():
    angle, middle, shares = zip(*LID_CURVE, strict=True)
    return jnp.array(angle), jnp.array(middle), jnp.array(shares)


def _nearest(center, size):
    """The curve's point nearest to the lid: its segment, and its share along it."""
    return sight.nearest_on(_curve()[1], relative(LID, BOX, center, size))


def _between(values, segment, share):
    return values[segment] + share * (values[segment + 1] - values[segment])


def _sizes(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    segment, share = _nearest(center, size)
    return size.at[LID].multiply(_between(_curve()[2], segment, share))


def _lid_open(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Bool[Array, ""]:
    return _between(_curve()[0], *_nearest(center, size)) > _OPEN


def _open_lid(
    key: PRNGKeyArray, center: Float[Array, "N 2"], size: Float[Array, "N 2"]
) -> Float[Array, "N 2"]:
    key_angle, key_aside = jax.random.split(key)
    low, high = _AT_REST
    at = jax.random.uniform(key_angle, (), minval=low, maxval=high)
    angles, middle, _ = _curve()
    place = jnp.stack([jnp.interp(at, angles, middle[:, axis]) for axis in range(2)])
    place += jax.random.uniform(key_aside, (2,), minval=-_ASIDE, maxval=_ASIDE)
    return center.at[LID].set(center[BOX] + place * size[BOX])
