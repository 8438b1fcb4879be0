"""A scene of MAGICAL's rendered from above as pixels, by one pure function on the device.

Geometry and colours are those of `scene`, whose outlines are painted on the host. Here each pixel
asks every body how far from its outline it is, in pixels, negative inside, and bodies are painted
one over the other: arithmetic alone, which XLA fuses into one pass. Lines have pointed corners. B
blocks; R regions; N bodies: the robot's, then (gripper only) its fingers, then the blocks.
"""

import functools
import math
from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from gril_jax.envs.checks import check_known
from gril_jax.envs.planar import robots, shapes
from jaxtyping import Array, Float, Int, UInt8

from . import scene

COLOURS = tuple(scene.FILL)

_Plane = Float[Array, "#S #S"]  # a number a pixel, or a row or column of them
_Pixels = Float[Array, "S S 3"]


class Painting(NamedTuple):
    """A scene to paint. Lengths are in arena units, angles in radians, counter-clockwise."""

    pose: Float[Array, "N 3"]  # x, y, angle; a finger's x, y is its pivot; closed: robot's angle
    shape: Int[Array, "B"]  # index into `planar.shapes.SHAPES`: star, square, pentagon, circle
    colour: Int[Array, "B"]  # index into `COLOURS`: green, blue, yellow, red
    regions: Float[Array, "R 4"]  # centre x, y; width, height
    region_colour: Int[Array, "R"]  # index into `COLOURS`


class _Canvas(NamedTuple):
    """The places of the pixels."""

    x: Float[Array, "1 S"]  # of their centres, in pixels from the picture's middle
    y: Float[Array, "S 1"]
    scale: float  # pixels a unit
    zoom: float  # pixels a pixel of the 384-pixel picture that widths are given for
    antialias: bool

    def width(self, pixels: int) -> float:
        """Width of a line, in pixels."""
        return pixels * self.zoom if self.antialias else float(round(pixels * self.zoom))

    def local(self, pose: Float[Array, "3"]) -> tuple[_Plane, _Plane]:
        """The pixels in a body's frame: to its right, and forward."""
        c, s = jnp.cos(pose[2]), jnp.sin(pose[2])
        right, up = self.x - self.scale * pose[0], self.y - self.scale * pose[1]
        return c * right + s * up, c * up - s * right


class _Layer(NamedTuple):
    """One painted outline; the line around it, if any, is centred on it."""

    distance: _Plane
    fill: Int[Array, "3"]
    rim: Int[Array, "3"] | None = None
    width: float = 0.0  # of the line, in pixels


def render(
    drawn: Painting,
    *,
    robot: str = "gripper",
    arena: float = 1.1,
    size: int = 384,
    half_extent: float = 1.122,
    antialias: bool = False,
    look: scene.Look = scene.X_MAGICAL,
    robot_first: bool = False,
) -> UInt8[Array, "size size 3"]:
    """Renders one picture of a scene in RGB; x points right, y up, and row 0 is the top.

    Every keyword is static; poses, shapes and colours are data, so one compiled picture serves
    all scenes of as many blocks and regions. A pose that is not finite hides its body, and so does
    one outside of the picture.

    Args:
      drawn: what to paint; an index beyond its list counts as the nearest in it.
      robot: one of `planar.robots.ROBOTS`.
      arena, half_extent: half the width of the floor, and of the world that the picture shows.
      size: width and height of the picture in pixels.
      antialias: mix colours at edges by the share of the pixel that is covered, judged by the
        distance of its centre. Lines then keep their true width, be it a fraction of a pixel.
        Without it, every pixel has one colour of the palette, and lines are whole pixels wide. In
        pictures of 192 pixels or less the lines of blocks and robot then vanish, as in the module
        `filming` of `gril_jax.workflows.build`.
      look: how floor and regions are painted.
      robot_first: paint the robot below the blocks, not above them.

    Raises:
      ValueError: an option is not one of those above, or shapes, colours and poses do not fit
        together.
    """
    _check(drawn, robot, size, half_extent, arena)
    place = jnp.arange(size, dtype=jnp.float32) - (size - 1) / 2
    scale, zoom = size / (2 * half_extent), size / 384
    canvas = _Canvas(place[None, :], -place[:, None], scale, zoom, antialias)
    ground, blocks = _ground(drawn, look, arena, canvas), [*_blocks(drawn, canvas)]
    parts = drawn.pose[: drawn.pose.shape[0] - drawn.shape.shape[0]]
    machine = [*_robot(parts, robot, canvas)]
    bodies = machine + blocks if robot_first else blocks + machine
    return _paint([*ground, *bodies], size, antialias)


def _check(drawn: Painting, robot: str, size: int, half_extent: float, arena: float) -> None:
    check_known("robot", robot, robots.ROBOTS)
    if size < 1:
        raise ValueError(f"size is {size}, but a picture needs at least 1 pixel")
    for name, value in (("half_extent", half_extent), ("arena", arena)):
        if not 0 < value < math.inf:
            raise ValueError(f"{name} is {value}, but must be a positive length")
    parts, blocks = (3 if robot == "gripper" else 1), drawn.shape.shape[0]
    if drawn.colour.shape[0] != blocks:
        raise ValueError(f"{blocks} shapes need as many colours, not {drawn.colour.shape[0]}")
    if drawn.pose.shape != (parts + blocks, 3):
        raise ValueError(
            f"poses of shape {drawn.pose.shape} do not fit: the {robot} robot with {blocks} blocks "
            f"needs {(parts + blocks, 3)}"
        )


def _paint(layers: Iterable[_Layer], size: int, antialias: bool) -> UInt8[Array, "size size 3"]:
    """Paints layers in order: a line's colour up to its outer side, the fill to its inner side."""

    def blend(image: _Pixels, depth: Float[Array, "S S 1"], colour, below) -> _Pixels:
        """Paints an edge one pixel wide; `below` is the present colour of the covered share."""
        if not antialias:
            return jnp.where(depth > 0, colour, image)
        share = jnp.where(depth > -0.5, jnp.minimum(depth + 0.5, 1.0), 0.0)  # 0 for NaN
        return image + share * (colour - below)

    image = jnp.broadcast_to(jnp.array(scene.BACKGROUND, jnp.float32), (size, size, 3))
    for distance, fill, rim, width in layers:
        depth = -distance[..., None]
        if not width:
            image = blend(image, depth, fill, image)
        else:
            image = blend(image, depth + width / 2, rim, image)
            image = blend(image, depth - width / 2, fill, rim)
    return jnp.round(image).astype(jnp.uint8)


def _ground(drawn: Painting, look: scene.Look, arena: float, canvas: _Canvas) -> Iterable[_Layer]:
    floor = jnp.maximum(jnp.abs(canvas.x), jnp.abs(canvas.y)) - canvas.scale * arena
    line = canvas.width(look.floor_width)
    yield _Layer(floor, jnp.array(scene.FLOOR), jnp.array(scene.GREY), line)
    for place, colour in zip(drawn.regions, drawn.region_colour, strict=True):
        (x, y), half = canvas.scale * place[:2], canvas.scale * place[2:] / 2
        region = jnp.maximum(jnp.abs(canvas.x - x) - half[0], jnp.abs(canvas.y - y) - half[1])
        yield _Layer(region, _pick(look.goal_fill, colour))
        if canvas.width(look.goal_width):
            yield _Layer(_dashes(place, look, canvas), _pick(scene.FILL, colour))


def _blocks(drawn: Painting, canvas: _Canvas) -> Iterable[_Layer]:
    blocks = drawn.shape.shape[0]
    wedges = jnp.take(_WEDGES, drawn.shape, axis=0, mode="clip")
    for i, pose in enumerate(drawn.pose[drawn.pose.shape[0] - blocks :]):
        distance = _block(wedges[i], *canvas.local(pose), canvas.scale)
        fill, rim = (_pick(palette, drawn.colour[i]) for palette in (scene.FILL, scene.RIM))
        yield _Layer(distance, fill, rim, canvas.width(scene.BODY_WIDTH))


def _robot(parts: Float[Array, "P 3"], robot: str, canvas: _Canvas) -> Iterable[_Layer]:
    scale, line = canvas.scale, canvas.width(scene.BODY_WIDTH)
    grey, grey_rim = jnp.array(scene.GREY), jnp.array(scene.GREY_RIM)
    right, forward = canvas.local(parts[0])
    if robot != "gripper":
        half_width, half_depth = robots.robot(robot).parts[0].boxes[0].half
        stick = jnp.maximum(
            jnp.abs(right) - scale * half_width, jnp.abs(forward) - scale * half_depth
        )
        yield _Layer(stick, grey, grey_rim, line)
        return
    for side, pose in zip((-1, 1), parts[1:], strict=True):
        across, along = canvas.local(pose)
        yield _Layer(_finger(side * across, along, scale), jnp.array(scene.BACKGROUND), grey, line)
    yield _Layer(_disc(right, forward, scale * scene.ROBOT_RADIUS), grey, grey_rim, line)
    eye = jnp.abs(right) - scale * scene.EYE[0], forward - scale * scene.EYE[1]  # both at once
    yield _Layer(_disc(*eye, scale * scene.EYE_RADIUS), jnp.array(scene.EYE_FILL))
    yield _Layer(_disc(*eye, scale * scene.PUPIL_RADIUS), jnp.array(scene.PUPIL_FILL))


def _pick(palette: dict[str, tuple[int, int, int]], index: Int[Array, ""]) -> Int[Array, "3"]:
    return jnp.take(jnp.array([palette[c] for c in COLOURS]), index, axis=0, mode="clip")


def _disc(x: _Plane, y: _Plane, radius: float) -> _Plane:
    """Distance from a disc, to first order: XLA would not fuse a square root.

    Only where a smooth disc is no larger than its edge, as pupils in small pictures, is it paler.
    """
    return (x * x + y * y) / (2 * radius) - radius / 2


def _wedge(name: str) -> np.ndarray:
    """Parameters of a block: two mirrors' normals, an edge's normal, curvature and offset.

    A regular outline is the same in every wedge between a corner and the middle of an edge (or a
    tip and a notch), so a point that is mirrored into one wedge has one edge to look at. A circle
    has no edge: it is `_disc`.
    """
    vertices = shapes.outline(name)
    if name == "circle":
        radius = np.linalg.norm(vertices[0])
        return np.array([0, 0, 0, 0, 0, 0, 1 / (2 * radius), radius / 2])
    angles = np.radians([-90, 135] if name == "square" else [-36, 216])
    normals, offsets = _half_planes(vertices)
    mirrors = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.array([*mirrors.ravel(), *normals[-1], 0, offsets[-1]])


def _half_planes(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward normals (V, 2) and offsets (V,) of a counter-clockwise outline's edges.

    Edge i runs from vertex i to the next, so the last one ends in vertex 0.
    """
    along = np.roll(vertices, -1, axis=0) - vertices
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals /= np.linalg.norm(along, axis=1, keepdims=True)
    return normals, np.sum(normals * vertices, axis=1)


_WEDGES = np.stack([_wedge(name) for name in shapes.SHAPES]).astype(np.float32)
# Edges of a finger: outer side of the arm, of the forearm, tip, the inner sides, root.
_FINGER = robots.robot("gripper").parts[2].outline
_SIDES = _half_planes(_FINGER)
_ELBOW = _half_planes(_FINGER[[1, 4]])  # between arm and forearm


def _block(wedge: Float[Array, "8"], x: _Plane, y: _Plane, scale: float) -> _Plane:
    x = jnp.abs(x)
    for a, b in (wedge[:2], wedge[2:4]):
        twice = 2 * jnp.maximum(a * x + b * y, 0.0)
        x, y = x - twice * a, y - twice * b
    edge = wedge[4] * jnp.abs(x) + wedge[5] * y
    return edge + wedge[6] / scale * (x * x + y * y) - scale * wedge[7]


def _finger(x: _Plane, y: _Plane, scale: float) -> _Plane:
    """Signed distance to the right finger: arm, or beyond the elbow forearm; each is convex."""

    def outside(edges: tuple[np.ndarray, np.ndarray], *numbers: int) -> _Plane:
        rows = [(*map(float, edges[0][i]), float(edges[1][i])) for i in numbers]
        return functools.reduce(jnp.maximum, [a * x + b * y - scale * c for a, b, c in rows])

    beyond = outside(_ELBOW, 0) > 0
    return jnp.where(beyond, outside(_SIDES, 1, 2, 3), outside(_SIDES, 4, 5, 0))


def _dashes(goal: Float[Array, "4"], look: scene.Look, canvas: _Canvas) -> _Plane:
    """The dashes of a region's rim, which restart at each corner.

    Sides run counter-clockwise, so half a turn takes top to bottom and left to right.
    """
    x, y = canvas.x - canvas.scale * goal[0], canvas.y - canvas.scale * goal[1]
    length, dash = canvas.scale * goal[2:], canvas.zoom * look.goal_dash
    start = 2 * dash * jnp.floor(length / (2 * dash))
    short = length - start <= canvas.zoom * look.goal_width  # such a last dash is left out
    end = jnp.where(short, start - dash, length)
    half_width = canvas.width(look.goal_width) / 2

    def side(along: _Plane, across: _Plane, i: int) -> _Plane:
        along = along + length[i] / 2
        phase = along - 2 * dash * jnp.floor(along / (2 * dash))
        gap = jnp.maximum(jnp.abs(phase - dash / 2) - dash / 2, jnp.maximum(along - end[i], -along))
        return jnp.maximum(gap, jnp.abs(across - length[1 - i] / 2) - half_width)

    bottom = side(jnp.where(y > 0, -x, x), jnp.abs(y), 0)
    right = side(jnp.where(x < 0, -y, y), jnp.abs(x), 1)
    return jnp.minimum(bottom, right)
