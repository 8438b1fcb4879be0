"""The scene of item in the drawer: a chest whose middle drawer opens, and a cube on top of it.

The chest is a mocap body with its origin on the table below its middle; it opens along +y, by 0 to
0.22 m. The other two drawers are painted fronts. The drawer as a thing is its front with the
handle, which a camera sees whether it is open or not. Lengths are metres.
"""

from gril_jax.envs.panda.model import PADS, PALM, TIPS
from gril_jax.envs.tabletop import mjcf
from gril_jax.envs.tabletop.physics import TABLE, Additions

CHEST_HALF = (0.15, 0.15, 0.17)
TRAVEL = 0.22
FLOOR, RIM = 0.154, 0.244  # heights in the drawer
INSIDE = ((-0.12, -0.13), (0.12, 0.14))  # the drawer's space, x and y of its frame
BAR = (0.0, 0.21, 0.197)  # the middle of the handle, in the drawer's frame
FRONT_CENTER, FRONT_HALF = (0.0, 0.179, 0.197), (0.13, 0.038, 0.05)  # with the handle
ITEM_HALF = (0.02, 0.02, 0.02)
TOP = 2 * CHEST_HALF[2]

_PLATES = {
    "drawer_floor": ((0.0, 0.005, 0.15), (0.12, 0.135, 0.004)),
    "drawer_back": ((0.0, -0.134, 0.197), (0.12, 0.004, 0.047)),
    "drawer_near": ((-0.124, 0.0, 0.197), (0.004, 0.138, 0.047)),
    "drawer_far": ((0.124, 0.0, 0.197), (0.004, 0.138, 0.047)),
}
_FRONT = ((0.0, 0.145, 0.197), (0.13, 0.005, 0.05))
_CHEST = {
    "chest_top": ((0.0, 0.0, 0.334), (0.15, 0.15, 0.006)),
    "chest_front": ((0.0, 0.145, 0.294), (0.15, 0.005, 0.034)),
}
_PAINTED = (  # sides, back, floor, and the front of the drawer below
    ((-0.145, 0.0, 0.164), (0.005, 0.15, 0.164)), ((0.145, 0.0, 0.164), (0.005, 0.15, 0.164)),
    ((0.0, -0.145, 0.164), (0.14, 0.005, 0.164)), ((0.0, 0.145, 0.07), (0.14, 0.005, 0.07)),
)  # fmt: skip


def _drawer() -> str:
    x, y, z = BAR
    posts = (mjcf.box("", (side * 0.045, y - 0.03, z), (0.005, 0.03, 0.005)) for side in (-1, 1))
    bar = f'fromto="{x - 0.05} {y} {z} {x + 0.05} {y} {z}"'
    trough = "".join(mjcf.box(name, *shape, 0.2) for name, shape in _PLATES.items())
    return (
        '<body name="drawer"><joint name="slide" type="slide" axis="0 1 0"'
        f' range="0 {TRAVEL}" damping="4" frictionloss="1" armature="0.1"/>'
        f"{mjcf.box('drawer_front', *_FRONT, 0.4)}{''.join(posts)}"
        f'<geom name="handle" type="capsule" size="0.007" mass="0.05" {bar}/>'
        f'<body name="trough">{trough}</body></body>'
    )


def scene() -> Additions:
    """The scene; joints after the arm's are the drawer's slide (metres), then the item's."""
    shapes = [mjcf.box(name, *shape) for name, shape in _CHEST.items()]
    shapes += [mjcf.box("", *shape) for shape in _PAINTED]
    item = mjcf.loose("item", mjcf.box("item", (0, 0, 0), ITEM_HALF, 0.064))
    solid = (*_CHEST, "drawer_front")
    pairs = [("item", other) for other in (TABLE, *PADS, *_PLATES, *solid)]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, "handle", *_PLATES, *solid)]
    pairs += [(PALM, other) for other in (*solid, "handle")]
    return Additions(mjcf.fixed("chest", *shapes, _drawer()) + item, tuple(pairs))
