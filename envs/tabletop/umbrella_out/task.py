"""Take the umbrella out of its stand. A Panda at a table; see `tabletop`.

Geometry after RLBench's take_umbrella_out_of_umbrella_stand, built anew from primitives.

Things: stand, umbrella.
Stage: the umbrella out: all of it above the rim of the stand, and held by both fingertips. Success:
so at 5 moments in a row. Progress: reaching for the crook, holding it, the height of the tip.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, out_of, rotation
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
_RISE = 0.0006  # metres: the tip's height at the start, as it is round
# The umbrella's middle from the stand's, in its sizes: out, and clearly so. How far aside it is
# held does not matter.
_OUT, _CLEARLY = Area((-5.0, 0.8), (7.0, 5.0)), Area((-0.3, 1.0), (1.5, 1.4))


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
    return Stages(
        (out,), movable=(umbrella,), robots=sight.ROBOTS, half_extent=half_extent,
        score=sight.share_that_holds,
    )  # fmt: skip


TASK = Task(
    things=("stand", "umbrella"), stages=("umbrella out",), scene=model.scene(), home=HOME,
    start=_start, boxes=_boxes, progress=_progress, episode_length=100, by_boxes=stages,
    colours=((0.3, 0.31, 0.35), (0.2, 0.36, 0.68)),
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
