"""Scenes for the tests of `raster`, and their pictures painted from exact geometry in float64."""

import math

import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical import raster
from gril_jax.envs.magical import scene as look
from gril_jax.envs.planar import robots
from gril_jax.envs.planar.shapes import SHAPES, outline

from support import scenes
from support.planar_scenes import signed_distance

HALF = 1.122
OPEN = math.pi / 8
NAMES = tuple(f"{c} {s}" for c in raster.COLOURS for s in SHAPES)
DEMO = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
GOAL = (0.40, 0.35, 0.60, 0.70)
STICKS = {"short": 0.3, "medium": 0.6, "long": 1.6}
NOWHERE = np.full(3, np.nan)
RGB = {
    "floor": ((255, 255, 255), (162, 163, 175)),
    "finger": ((231, 231, 234), (162, 163, 175)),
    "body": ((162, 163, 175), (144, 145, 159)),
}


# ---------------------------------------------------------------- scenes


def _pivot(robot, side):
    x, y, angle = robot
    c, s = math.cos(angle), math.sin(angle)
    px, py = robots.PIVOTS[0 if side < 0 else 1]
    return x + c * px - s * py, y + s * px + c * py


def made_scene(names, blocks, robot=scenes.ROBOT, fingers=(OPEN, -OPEN), goal=GOAL, colour="green"):
    """`fingers` None is a stick. A robot that is nowhere takes its fingers along."""
    poses = [robot]
    if fingers is not None:
        turned = zip((-1, 1), fingers, strict=True)
        poses += [(*_pivot(robot, side), robot[2] + angle) for side, angle in turned]
    split = [name.split() for name in names]
    return raster.Painting(
        pose=jnp.array([*poses, *blocks], jnp.float32).reshape(-1, 3),
        shape=jnp.array([SHAPES.index(s) for _, s in split], jnp.int32),
        colour=jnp.array([raster.COLOURS.index(c) for c, _ in split], jnp.int32),
        regions=jnp.array([goal], jnp.float32),
        region_colour=jnp.array([raster.COLOURS.index(colour)]),
    )


def random_arguments(seed, fingers=True):
    """Arguments of `made_scene`: everything anywhere, bodies partly outside and partly hidden."""
    rng = np.random.default_rng(seed)
    names = [NAMES[i] for i in rng.permutation(16)[:5]]
    pose = rng.uniform([-1.1, -1.1, -4], [1.1, 1.1, 4], (6, 3))
    opening = (rng.uniform(0, OPEN), rng.uniform(-OPEN, 0)) if fingers else None
    goal = (*rng.uniform(-0.6, 0.6, 2), *rng.uniform(0.5, 0.8, 2))
    return names, pose[1:], pose[0], opening, goal, names[0].split()[0]


def demo_arguments():
    return DEMO, [scenes.BLOCKS[name] for name in DEMO]


# ---------------------------------------------------------------- exact geometry, in float64


class _Exact:
    """A painter of exact shapes, and of where it would not quarrel about a pixel."""

    def __init__(self, size):
        self.scale, self.zoom = size / (2 * HALF), size / 384
        place = (np.arange(size) + 0.5) / self.scale - HALF
        self.x, self.y = place[None, :], -place[:, None]
        self.image = np.full((size, size, 3), look.BACKGROUND, np.uint8)
        self.doubt = np.zeros((size, size), bool)

    def coat(self, distance, fill, rim=None, width=0, corners=()):
        reach = round(width * self.zoom) / 2 / self.scale
        for colour, limit in ((rim, reach), (fill, -reach)):
            if colour is not None:
                self.doubt &= ~(distance < limit - 0.02 / self.scale)
                self.image[distance < limit] = colour
            self.doubt |= abs(distance - limit) < 0.02 / self.scale
        for x, y in corners if reach else ():  # lines have round corners here, pointed ones there
            self.doubt |= np.hypot(self.x - x, self.y - y) < 2.4 * reach

    def polygon(self, vertices, fill, rim=None, width=0):
        self.coat(signed_distance(self.x, self.y, vertices), fill, rim, width, vertices)

    def disc(self, x, y, radius, fill, rim=None, width=0):
        self.coat(np.hypot(self.x - x, self.y - y) - radius, fill, rim, width)


def _dashes(goal, width):
    """Rectangles (4, 2): 10 pixels on, 10 off, from each corner on, counter-clockwise."""
    unit = 2 * HALF / 384
    x, y, w, h = goal
    corners = np.array([(x - w / 2, y - h / 2), (x + w / 2, y - h / 2)])
    corners = np.concatenate([corners, 2 * np.array([x, y]) - corners])
    for i, length in enumerate((w, h, w, h)):
        along = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][i])
        across = width / 2 * np.array([-along[1], along[0]])
        for start in np.arange(0, length, 20 * unit):
            stop = min(start + 10 * unit, length)
            if stop - start > 4 * unit:
                a, b = corners[i] + along * start, corners[i] + along * stop
                yield np.array([a - across, b - across, b + across, a + across])


def exact_picture(names, blocks, robot, fingers, goal, colour, *, stick=None, size=384):
    canvas = _Exact(size)
    canvas.polygon(1.1 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), *RGB["floor"], 2)
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    rim, _, fill = scenes.COLOURS[colour]
    canvas.polygon(np.array(goal[:2]) + signs * np.array(goal[2:]) / 2, fill)
    line = round(4 * canvas.zoom)
    for dash in _dashes(goal, line / canvas.scale):
        canvas.polygon(dash, rim)
    for name, pose in zip(names, blocks, strict=True):
        colour, kind = name.split()
        fill, rim, _ = scenes.COLOURS[colour]
        if kind == "circle":
            canvas.disc(*pose[:2], 0.12, fill, rim, 1)
        else:
            vertices = outline(kind)
            np.testing.assert_allclose(vertices, scenes.corners(kind), atol=1e-4)
            canvas.polygon(scenes.placed(vertices, *pose), fill, rim, 1)
    if stick:
        half = np.array([STICKS[stick], 0.1]) / 2
        canvas.polygon(scenes.placed(signs * half, *robot), *RGB["body"], 1)
        return canvas
    for side, angle in zip((-1, 1), fingers, strict=True):
        vertices = robots.robot("gripper").parts[1 if side < 0 else 2].outline
        placed = scenes.placed(vertices, *_pivot(robot, side), robot[2] + angle)
        canvas.polygon(placed, *RGB["finger"], 1)
    canvas.disc(*robot[:2], 0.2, *RGB["body"], 1)
    eyes = scenes.placed(np.array([(-0.08, 0.06), (0.08, 0.06)]), *robot)
    for eye in eyes:
        canvas.disc(*eye, 0.04, (255, 255, 255))
        canvas.disc(*eye, 0.024, (26, 26, 26))
    return canvas


# ---------------------------------------------------------------- beside the host's


def near_edge(image):
    """Pixels one of whose eight neighbours, or who themselves, stand at a change of colour."""
    padded = np.pad(image.astype(int), ((1, 1), (1, 1), (0, 0)), mode="edge")
    size = len(image)
    around = [padded[r : r + size, c : c + size] for r in range(3) for c in range(3)]
    return np.any([(a != image).any(axis=2) for a in around], axis=0)


def compare(ours, theirs):
    """Share of pixels that differ at all and by much, and whether one is far from an edge."""
    difference = np.abs(ours.astype(int) - theirs).max(axis=2)
    stray = (difference > 3) & ~near_edge(theirs)  # 3: a smooth star's tips are pointed
    return (difference > 0).mean(), (difference > 40).mean(), stray.any()
