"""The scene of empty container: a tray with three blocks, a bin for them, and another bin.

Tray and bins are mocap bodies, their origins on the table below their middles. The other bin is
painted alone: what falls into it lies on the table. Lengths are metres.
"""

from gril_jax.envs.panda.model import PADS, TIPS
from gril_jax.envs.tabletop import mjcf
from gril_jax.envs.tabletop.physics import TABLE, Additions

HEIGHT = 0.05  # of tray and bins
TRAY, BIN = (0.136, 0.136), (0.096, 0.0585)  # half their spaces
BLOCKS = ((0.035, 0.018, 0.0125), (0.03, 0.02, 0.015), (0.04, 0.015, 0.0125))  # half extents

_WALLS = mjcf.walls("tray", TRAY, HEIGHT) | mjcf.walls("bin", BIN, HEIGHT)
_NAMES = ("block_a", "block_b", "block_c")


def outside(space: tuple[float, float]) -> tuple[float, float, float]:
    """Half extents of the box around a tray or bin of that space."""
    return mjcf.outside(space, HEIGHT)


def _standing(name: str, walls: dict[str, tuple]) -> str:
    return mjcf.fixed(name, *(mjcf.box(wall, *shape) for wall, shape in walls.items()))


def scene() -> Additions:
    """The scene; joints after the arm's are one free joint for each block."""
    standing = _standing("tray", mjcf.walls("tray", TRAY, HEIGHT))
    standing += _standing("bin", mjcf.walls("bin", BIN, HEIGHT))
    standing += _standing("other_bin", mjcf.walls("other_bin", BIN, HEIGHT))
    blocks = "".join(
        mjcf.loose(name, mjcf.box(name, (0, 0, 0), half, 0.1))
        for name, half in zip(_NAMES, BLOCKS, strict=True)
    )
    pairs = [(block, other) for block in _NAMES for other in (TABLE, *PADS, *_WALLS)]
    pairs += [(a, b) for i, a in enumerate(_NAMES) for b in _NAMES[i + 1 :]]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, *_WALLS)]
    return Additions(standing + blocks, tuple(pairs))
