"""The state of a table that shows given boxes, by least squares: the inverse of the camera.

Sizes of things are known, and what lies has the height of a floor, so a box's four numbers tell a
thing's place and turn. A hand is told by its own boxes, and what it holds is at it. A seen
box that is smaller than it should be is cheap, as things hide each other; a small turn is told from
that to the other side by the task's own arrangement.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.kinematics import Frame, about_z
from jaxtyping import Array, Bool, Float

from . import boxes
from .boxes import Boxes, Camera
from .least_squares import least
from .resting import Grip, Layout, Rail, put_down, within
from .start import Start, free_joint

_PIXEL = 2 / 256  # of the picture: how well edges are known
_HIDDEN, _MORE = 2.0, 0.05  # pixels: about the cost of a hidden edge, and for each pixel more
_TURN = 0.25  # rad: how far turns are from the task's own
_LIE = 0.002  # metres: how far a middle's height is from that of what lies on the table
_ANYWHERE = 100.0  # metres: of what lies, along the table
_HELD = 0.02  # metres: how far the middle of what is held is from the tool centre point
_HEIGHTS = (0.05, 0.2, 0.4)  # metres: of the tool centre point, where the search begins
_YAWS = (-0.4, 0.4, 1.2, 1.9)  # rad: of the hand from the usual, where the search begins
_LOST = 4.0  # pixels: about the cost of a finger's edge that is elsewhere
_LIFTED = 0.02  # metres: higher than what lies, what hangs in the air
_WITHIN = 0.04  # metres: of the tool centre point, the middle of what is held
_PAD = 0.01  # metres: how far its middle is above or below that point
_GAP = 0.002  # metres: what fingers must be able to open beyond what they hold
_ELSEWHERE = np.array([50.0, 50.0, 0.0], np.float32)  # metres: out of the way of what lies
_TURNS = (-0.4, -0.13, 0.13, 0.4)  # rad: where the search for turns begins
_GRIP_TURN = 0.4  # rad: how far the hand is turned, from where its fingers open along y
_ALONG = (0.05, 0.5, 0.95)  # of a rail
_BEYOND = 0.02  # of a rail's length: how far a thing is seen beyond its ends


def start_from(
    center: Float[Array, "N 2"], size: Float[Array, "N 2"], layout: Layout, camera: Camera,
    own: Start, things: Callable[[Array, Array], Boxes], held: Bool[Array, "N"],
    home: Float[Array, "7"], tilt: float,
) -> tuple[Start, Grip]:  # fmt: skip
    """The start at rest whose boxes in the picture are the given ones, of the robot's three objects
    and the task's, and the hand there.

    What hangs in the air is held, if it is between fingers that can hold it, else it comes to lie
    below; a lid falls to the side where it is. `own` is the task's
    arrangement, `things` their boxes in space by (joints, fixtures). Boxes that are not finite give
    the task's own.
    """
    known = jnp.isfinite(center).all() & jnp.isfinite(size).all()
    edges = _edges(jnp.where(known, center, 0.0), jnp.where(known, size, 0.1))
    robot, seen = edges[:3], edges[3:]
    first = len(seen) - len(layout.loose)
    half, held = jnp.array(layout.loose), held[3 + first :]
    held &= jnp.cumsum(held) == 1  # a hand holds one thing: the first
    with jax.default_matmul_precision("highest"):
        base, rails = _standing(seen, layout, camera, own, things)
        fallen = [_fallen(at, rail) for at, rail in zip(rails, layout.rails, strict=True)]
        turned = base[0, 2] - _yaw(own.fixtures[0, 3:])
        upright = _without_yaw(own.joints[len(layout.rails) :].reshape(-1, 7)[:, 3:])
        yaws = turned + jax.vmap(_yaw)(own.joints[len(layout.rails) :].reshape(-1, 7)[:, 3:])
        tool = _tool(robot, camera, home, tilt)
        spots = _spots(layout, base, fallen)
        sinks = jax.vmap(lambda turn, half: jnp.abs(turn[2]) @ half)(upright, half)
        floors = _floors(seen[first:], layout, spots, sinks, camera)
        look = functools.partial(_loose, tool=tool[:3], grip=layout.grip, camera=camera)
        looks = jax.vmap(look)(seen[first:], half, upright, yaws, floors + sinks, held)
        grip, hung = _grip(tool, looks, half, upright, looks[:, 2] - floors - sinks, held, layout)
        is_held = jnp.arange(len(half)) == grip.held
        away = jnp.where(is_held[:, None], _ELSEWHERE, 0.0)
        level = half.at[:, 2].set(sinks)
        places, heights = put_down(
            looks[:, np.array([0, 1, 3])] + away, level, layout.spaces, spots
        )
        poses = jnp.stack([places[:, 0], places[:, 1], heights, places[:, 2]], axis=1)
        poses = jnp.where(is_held[:, None], hung, poses)
        loose = jax.vmap(_free_pose, (0, 0, None))(poses, upright, layout.middle)
    joints = jnp.concatenate([jnp.stack(fallen), loose.reshape(-1)] if fallen else [loose.ravel()])
    fixtures = free_joint(base, 0.0).reshape(-1, 7)
    known &= jnp.isfinite(joints).all() & jnp.isfinite(fixtures).all()
    start = own._replace(
        joints=jnp.where(known, joints, own.joints),
        fixtures=jnp.where(known, fixtures, own.fixtures),
    )
    return start, grip._replace(place=jnp.where(known, grip.place, jnp.nan))


def _fallen(at: Float[Array, ""], rail: Rail) -> Float[Array, ""]:
    """The place at which a thing on a rail comes to rest."""
    if rail.tips is None:
        return jnp.clip(at, rail.low, rail.high)
    return jnp.where(at < rail.tips, rail.low, rail.high)


def _spots(layout: Layout, base: Float[Array, "M 3"], fallen: list[Array]) -> Float[Array, "S 3"]:
    """Places (x, y, yaw) of the spaces."""
    found = []
    for space in layout.spaces:
        x, y, yaw = base[space.fixture]
        out = 0.0 if space.slide is None else fallen[space.slide]
        found.append(jnp.stack([x - out * jnp.sin(yaw), y + out * jnp.cos(yaw), yaw]))
    return jnp.stack(found)


def _floors(
    seen: Float[Array, "L 4"], layout: Layout, spots: Float[Array, "S 3"],
    sinks: Float[Array, "L"], camera: Camera,
) -> Float[Array, "L"]:  # fmt: skip
    """Heights of the floors on which things lie that are seen there."""
    middles = (seen[:, :2] + seen[:, 2:]) / 2
    on = jax.vmap(functools.partial(_on_plane, camera))
    floors = jnp.array([space.floor for space in layout.spaces])
    places = jnp.stack([on(middles, floor + sinks) for floor in floors])
    return floors @ within(layout.spaces, spots, places)


def _without_yaw(turns: Float[Array, "L 4"]) -> Float[Array, "L 3 3"]:
    """Rotations of loose things at yaw 0, by their quaternions."""
    back = about_z(-jax.vmap(_yaw)(turns))
    return kinematics.compose(back, kinematics.rotation(turns))


def _free_pose(pose: Float[Array, "4"], upright: Float[Array, "3 3"], middle: float):
    """Position and quaternion (7,) of a thing, from its box's middle and its yaw."""
    lean = jnp.arctan2(upright[0, 2], upright[2, 2]) / 2  # about y: nothing leans another way
    turn = pose[3] / 2
    (c, s), (a, b) = (jnp.cos(turn), jnp.sin(turn)), (jnp.cos(lean), jnp.sin(lean))
    quaternion = jnp.stack([c * a, -s * b, c * b, s * a])
    axis = kinematics.rotation(quaternion)[:, 2]
    return jnp.concatenate([pose[:3] - middle * axis, quaternion])


def _grip(
    tool: Float[Array, "5"], looks: Float[Array, "L 4"], half: Float[Array, "L 3"],
    upright: Float[Array, "L 3 3"], hangs: Float[Array, "L"], known: Bool[Array, "L"],
    layout: Layout,
):  # fmt: skip
    """The hand, and the pose (x, y, z, yaw) of what it holds; `hangs` are heights above a floor.

    Pads lie flat against what they hold, whose middle is between them, or where it is taken.
    """
    place, yaw, opening = tool[:3], tool[3], tool[4]
    which = jnp.argmax(hangs + _ANYWHERE * known)
    look, extent = looks[which], half[which]
    quarters = jnp.round((yaw - look[3]) / (jnp.pi / 2))
    fits = lambda across: across < kinematics.FINGER_RANGE[1] - _GAP  # noqa: E731
    # Where only one pair of faces fits between the fingers, the nearest turn that has it there.
    halves = jnp.round((yaw - look[3]) / jnp.pi) * 2
    other = jnp.round((yaw - look[3]) / jnp.pi - 0.5) * 2 + 1
    quarters = jnp.where(fits(extent[0]), quarters, halves)
    quarters = jnp.where(fits(extent[1]), quarters, other)
    across = jnp.where(quarters % 2 == 0, extent[1], extent[0])
    taken = layout.grip * kinematics.turned(about_z(look[3]), upright[which][:, 2])
    point = look[:3] + taken
    free = (hangs[which] > _LIFTED) & (jnp.linalg.norm(point - place) < _WITHIN)
    held = (free | known[which]) & fits(across)
    turn = look[3] + quarters * (jnp.pi / 2)
    ahead = jnp.stack([jnp.cos(turn), jnp.sin(turn)])
    aside = jnp.clip((point[:2] - place[:2]) @ ahead, -_HELD, _HELD)
    high = jnp.clip(point[2], place[2] - _PAD, place[2] + _PAD)
    hung = jnp.stack([*(place[:2] + aside * ahead), high]) - taken
    grip = Grip(
        place, jnp.where(held, turn, yaw), jnp.where(held, across, opening),
        jnp.where(held, which, -1),
    )  # fmt: skip
    return grip, jnp.append(hung, look[3])


def _standing(seen, layout: Layout, camera: Camera, own: Start, things):
    """Places (M, 3) of the fixtures and positions of the rails."""
    count, rails = len(layout.standing), layout.rails
    shown = np.array([*layout.standing, *(rail.thing for rail in rails)])
    yaw = jax.vmap(_yaw)(own.fixtures[:, 3:])
    low, high = jnp.array([[rail.low, rail.high] for rail in rails]).reshape(-1, 2).T

    def residual(params):
        places, at = params[: 3 * count].reshape(count, 3), params[3 * count :]
        joints = own.joints.at[: len(rails)].set(at)
        found = things(joints, free_joint(places, 0.0).reshape(-1, 7))
        edges = _edges(*boxes.project(camera, Boxes(*(x[shown] for x in found))))
        misfit = _misfit(edges, seen[shown]).reshape(-1)
        beyond = (at - jnp.clip(at, low, high)) / (_BEYOND * (high - low))
        return jnp.concatenate([misfit, (places[:, 2] - yaw) / _TURN, beyond])

    def begin(turn, along):
        places = jnp.concatenate([own.fixtures[:, :2], (yaw + turn)[:, None]], axis=1)
        at = [rail.low + along * (rail.high - rail.low) for rail in rails]
        return jnp.concatenate([places.reshape(-1), jnp.array(at)])

    ways = [(turn, along) for turn in _TURNS for along in (_ALONG if rails else (0.0,))]
    found = least(residual, jnp.stack([begin(*way) for way in ways]))
    return found[: 3 * count].reshape(count, 3), found[3 * count :]


def _tool(seen: Float[Array, "3 4"], camera: Camera, home, tilt: float) -> Float[Array, "5"]:
    """The tool centre point of a hand that leans by `tilt`, its yaw and its opening."""
    usual = kinematics.tcp(home).rotation[:, 0]
    usual = jnp.arctan2(usual[1], usual[0])

    def shown(params):
        place, yaw, opening = params[:3], params[3], params[4]
        turn = kinematics.pointing(yaw, tilt)
        hand = Frame(place - kinematics.TCP * turn[:, 2], turn)
        return _edges(*boxes.project(camera, boxes.robot(hand, opening, opening)))

    def residual(params):
        middle = kinematics.FINGER_RANGE[1] / 2
        below = jnp.minimum(params[2], 0.0) / _LIE
        turned = (params[3] - usual) / _GRIP_TURN
        turned /= jnp.sqrt(1 + (turned / 2) ** 2)
        of_own = jnp.stack([turned, (params[4] - middle) / middle, below])
        off = _misfit(shown(params), seen)
        fingers = off[:2] / jnp.sqrt(1 + (off[:2] / _LOST) ** 2)
        return jnp.concatenate([fingers.reshape(-1), off[2], of_own])

    middle = (seen[2, :2] + seen[2, 2:]) / 2

    def begin(height, yaw):
        spot = _on_plane(camera, middle, height + kinematics.TCP)
        return jnp.concatenate([spot, jnp.stack([height, usual + yaw, jnp.float32(0.02)])])

    ways = jnp.array([(height, yaw) for height in _HEIGHTS for yaw in _YAWS])
    found = least(residual, jax.vmap(begin)(*ways.T))
    return found.at[4].set(jnp.clip(found[4], *kinematics.FINGER_RANGE))


def _loose(
    seen: Float[Array, "4"], half, upright, yaw, height, held, *, tool, grip: float, camera: Camera
) -> Float[Array, "4"]:
    """The pose (x, y, z, yaw) of a loose thing, which lies at a height or is held at the tool."""

    def residual(params, mean, about, cost):
        place, turn = params[:3], kinematics.compose(about_z(params[3]), upright)
        edges = _edges(*boxes.project(camera, Boxes(place, turn, half)))
        of_own = jnp.stack([(params[3] - yaw) / _TURN, cost])
        return jnp.concatenate([_misfit(edges, seen), (place - mean) / about, of_own])

    lies = jnp.append(_on_plane(camera, (seen[:2] + seen[2:]) / 2, height), height)
    hangs = tool - grip * kinematics.turned(about_z(yaw), upright[:, 2])
    means = jnp.repeat(jnp.stack([lies, hangs]), len(_TURNS), axis=0)
    abouts = jnp.array([[_ANYWHERE, _ANYWHERE, _LIE], [_HELD] * 3]).repeat(len(_TURNS), axis=0)
    # A hand hides the top of what it holds, which is no sign that a thing lies elsewhere.
    costs = jnp.array([_HIDDEN, 0.0]).repeat(len(_TURNS))
    costs = costs.at[: len(_TURNS)].add(_ANYWHERE * held)
    turns = jnp.tile(yaw + jnp.array(_TURNS), 2)
    starts = jnp.concatenate([means, turns[:, None]], axis=1)
    return least(residual, starts, means, abouts, costs)


def _edges(center: Float[Array, "*N 2"], size: Float[Array, "*N 2"]) -> Float[Array, "*N 4"]:
    return jnp.concatenate([center - size / 2, center + size / 2], axis=-1)


def _misfit(shown: Float[Array, "*N 4"], seen: Float[Array, "*N 4"]) -> Float[Array, "*N 4"]:
    """Residuals, in pixels: how far edges would be beyond those seen, where little is added to what
    one that is hidden costs."""
    beyond = (shown - seen) * np.array([-1, -1, 1, 1], np.float32) / _PIXEL
    far = jnp.maximum(beyond, 0.0)
    return jnp.minimum(beyond, 0.0) + far / jnp.sqrt(1 + (far / _HIDDEN) ** 2) + _MORE * far


def _on_plane(camera: Camera, point: Float[Array, "2"], height) -> Float[Array, "2"]:
    """The point (x, y) of a level plane, metres, at a point of the picture."""
    axes, place = boxes.axes(camera), np.array(camera.place, np.float32)
    scale = np.float32(np.tan(camera.field / 2))
    ray = axes[0] * point[0] * scale + axes[1] * point[1] * scale + axes[2]
    down = jnp.minimum(ray[2], -0.05)  # above the horizon there is no such point
    return place[:2] + (height - place[2]) / down * ray[:2]


def _yaw(turn: Float[Array, "4"]) -> Float[Array, ""]:
    """The turn about z of a quaternion."""
    return 2 * jnp.arctan2(turn[3], turn[0])
