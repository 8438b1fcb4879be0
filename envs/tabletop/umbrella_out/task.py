"""Take the umbrella out of its stand. A Panda at a table; see `tabletop`.

Geometry after RLBench's take_umbrella_out_of_umbrella_stand, built anew from primitives.

Things: stand, umbrella.
Stage: the umbrella out: all of it above the rim of the stand, and held by both fingertips. Success:
so at 5 moments in a row. Progress: reaching for the crook, holding it, the height of the tip.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, into, out_of, rotation
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, placing, sight
from gril_jax.envs.tabletop.boxes import Boxes, box, lowest, stacked
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.sight import Area
from gril_jax.envs.tabletop.start import YAW, Start, free_joint, group
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import expert, model

STAND = (0.55, -0.10, 0.0)  # x, y, yaw
_LEAST = 0.02  # metres of it that can always be seen
_RISE = 0.0006  # metres: the tip's height at the start, as it is round
# The umbrella's middle from the stand's, in its sizes: out, and clearly so. How far aside it is
# held does not matter.
_OUT, _CLEARLY = Area((-5.0, 0.8), (7.0, 5.0)), Area((-0.3, 1.0), (1.5, 1.4))
# How its box grows while it is drawn out: the middle's height, as above, and width and height as
# shares of those at the start. Means over 128 starts.
_GROWTH = (
    (0.341, 1.0, 1.0), (0.459, 1.109, 1.552), (0.583, 1.222, 2.142), (0.711, 1.334, 2.779),
    (0.846, 1.447, 3.452), (1.059, 1.492, 3.673), (1.284, 1.54, 3.911),
)  # fmt: skip
_BESIDE = 0.6  # in widths of the stand: an umbrella farther aside is not in it


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_lean = jax.random.split(key)
    stand = group(key_group, jnp.array([STAND]), share=share)
    yaw = stand[0, 2] + share * YAW * jax.random.uniform(key_lean, minval=-1.0)
    tip = stand[0, :2] + model.TIP * jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
    half, lean = yaw / 2, model.LEAN / 2
    (c, s), (a, b) = (jnp.cos(half), jnp.sin(half)), (jnp.cos(lean), jnp.sin(lean))
    turn = jnp.stack([c * a, -s * b, c * b, s * a])  # the lean about y, then the yaw about z
    joints = jnp.concatenate([tip, jnp.array([_RISE]), turn])
    return Start(joints, free_joint(stand, 0.0)[None], jnp.zeros((), bool))


def _umbrella(view: View) -> Frame:
    return Frame(view.joints[:3], rotation(view.joints[3:]))


def _boxes(view: View) -> Boxes:
    stand = box(placing.fixture(view, 0), (0.0, 0.0, model.RIM / 2), model.STAND_HALF)
    umbrella = box(_umbrella(view), (0.0, 0.0, model.LENGTH / 2), model.UMBRELLA_HALF)
    return stacked([stand, umbrella])


def _seen(view: View, things: Boxes) -> Boxes:
    """The boxes, of an umbrella that is in the stand the part above its rim alone."""
    frame, stand = _umbrella(view), placing.fixture(view, 0)
    within = (jnp.abs(into(stand, frame.position))[:2] < jnp.array(model.INSIDE)).all()
    upright = jnp.maximum(frame.rotation[2, 2], 0.1)
    hidden = jnp.clip((model.RIM - frame.position[2]) / upright, 0.0, model.LENGTH - _LEAST)
    hidden = jnp.where(within, hidden, 0.0)
    x, y, _ = model.UMBRELLA_HALF
    middle = jnp.zeros(3).at[2].set((hidden + model.LENGTH) / 2)
    part = box(frame, middle, jnp.stack([x, y, (model.LENGTH - hidden) / 2]))
    return Boxes(*(whole.at[1].set(own) for whole, own in zip(things, part, strict=True)))


def _progress(view: View, things: Boxes) -> StageProgress:
    umbrella = Boxes(*(x[1] for x in things))
    held, height = placing.held(view, umbrella), lowest(umbrella)
    out = held & (height > model.RIM)
    grip = out_of(_umbrella(view), jnp.array(model.GRIP))
    lift = jnp.clip(height / (1.1 * model.RIM), 0.0, 1.0)
    within = 0.3 * closeness(view.hand.position, grip) + held * (0.2 + 0.5 * lift)
    return StageProgress(out[None], within, out)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stage as seen in a picture, which shows the height and not the grip."""
    stand, umbrella = range(sight.FIRST, len(things))
    out = sight.placed("umbrella out", umbrella, stand, _OUT, _CLEARLY, others=(umbrella,))

    def sizes(center, size):
        x, y = sight.relative(umbrella, stand, center, size)
        height, *shares = jnp.array(_GROWTH).T
        beside = jnp.abs(x) > _BESIDE
        grown = [jnp.interp(jnp.where(beside, height[-1], y), height, share) for share in shares]
        return size.at[umbrella].multiply(jnp.stack(grown))

    return Stages(
        (out,), movable=(umbrella,), robots=sight.ROBOTS, half_extent=half_extent,
        score=sight.share_that_holds, sizes=sizes,
    )  # fmt: skip


TASK = Task(
    things=("stand", "umbrella"), stages=("umbrella out",), scene=model.scene(), home=HOME,
    start=_start, boxes=_boxes, progress=_progress, episode_length=100, by_boxes=stages,
    seen=_seen,
    colours=((0.3, 0.31, 0.35), (0.2, 0.36, 0.68)),
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
