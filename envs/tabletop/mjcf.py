"""MJCF of what stands and lies on the table: boxes, walls around a floor, free things.

Lengths are metres, masses kg.
"""

from gril_jax.envs.panda.model import words

_WALL = 0.004  # half its thickness
HIDDEN = 'group="5"'  # of shapes that touch and are not painted


def box(name: str, center, half, mass: float = 0.0, more: str = "") -> str:
    """A box, by its middle and half extents."""
    label = f'name="{name}" ' if name else ""
    place = f'pos="{words(center)}" size="{words(half)}"'
    return f'<geom {label}type="box" {place} mass="{mass}" {more}/>'


def fixed(name: str, *shapes: str) -> str:
    """A body that each episode puts elsewhere and no contact moves."""
    return f'<body name="{name}" mocap="true">{"".join(shapes)}</body>'


def loose(name: str, *shapes: str, joint: str = "") -> str:
    """A body that moves freely; `joint` are further attributes of its joint."""
    return f'<body name="{name}"><joint type="free" name="{name}" {joint}/>{"".join(shapes)}</body>'


def walls(name: str, half: tuple[float, float], height: float) -> dict[str, tuple]:
    """Middles and half extents of four walls on the table, by name; `half` is the space inside."""
    (x, y), z, w = half, height / 2, _WALL
    return {
        f"{name}_front": ((x + w, 0.0, z), (w, y, z)),
        f"{name}_back": ((-x - w, 0.0, z), (w, y, z)),
        f"{name}_left": ((0.0, y + w, z), (x + 2 * w, w, z)),
        f"{name}_right": ((0.0, -y - w, z), (x + 2 * w, w, z)),
    }


def outside(half: tuple[float, float], height: float) -> tuple[float, float, float]:
    """Half extents of the box around such walls."""
    return half[0] + 2 * _WALL, half[1] + 2 * _WALL, height / 2


def wires(half: tuple[float, float], height: float, *, rows: int = 3, posts: int = 3) -> str:
    """Thin bars along such walls: a basket that one sees through."""
    (x, y), w, shapes = half, _WALL / 2, []
    for row in range(rows):
        z = w + (height - 2 * w) * row / (rows - 1)
        shapes += [box("", (0, side * y, z), (x, w, w)) for side in (-1, 1)]
        shapes += [box("", (side * x, 0, z), (w, y, w)) for side in (-1, 1)]
    for post in range(posts):
        at = -1 + 2 * post / (posts - 1)
        shapes += [box("", (at * x, s * y, height / 2), (w, w, height / 2)) for s in (-1, 1)]
        if abs(at) < 1:
            shapes += [box("", (s * x, at * y, height / 2), (w, w, height / 2)) for s in (-1, 1)]
    return "".join(shapes)
