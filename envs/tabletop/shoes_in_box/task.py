"""Put both shoes into the box, after opening its lid. A Panda at a table; see `tabletop`.

Geometry after RLBench's put_shoes_in_box and the box of its open_box, built anew from primitives;
resets after it too: all things are moved as a group by up to 4 cm and 22.5 degrees, each shoe by up
to 2 cm and 0.3 rad. Unlike RLBench's, the grasp is one of friction.

Things: box, lid, shoe A (the nearer to the box at reset), shoe B.
Stages: the lid open (it has been at more than 90 degrees: gravity keeps it there), shoe A in, shoe
B in: the centre inside the walls and below 0.12 m, and released. Success: both shoes are in, slower
than 0.05 m/s, at 5 moments in a row; the lid may be at any angle then, as in RLBench.
Progress within a stage: reaching for the lip and the lid's angle; or, for the shoe outside that is
nearer to the box: reaching, holding it off the ground, its way to a point above the floor of the
box, and letting it go inside.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from gril_jax.envs.base import Demonstrations, Wanted
from gril_jax.envs.panda.frames import Frame, compose, into, out_of, rotation
from gril_jax.envs.tabletop.boxes import Boxes, box, free, lowest, stacked, touching
from gril_jax.envs.tabletop.demonstrations import JITTER, Expert, record
from gril_jax.envs.tabletop.recorded import moments
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.start import Footprint, Moments, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Tabletop, Task, View
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from . import expert, model, stages

LAYOUT = ((0.493, -0.15, 0.0), (0.48, 0.14, 0.0), (0.48, 0.27, 0.0))  # box, shoes: x, y, yaw
# The hand is above the things, its fingers open along y: tool centre point (0.50, 0.05, 0.30).
_HOME = (0.0571, -0.1029, 0.0417, -2.2644, 0.0052, 2.1616, 0.8812)
_OPEN, _OPENED = 1.571, 1.6  # rad: the stage, and where its progress ends
_BELOW_RIM = 0.12  # metres: of a shoe's centre; two on top of each other are
_DROP = (0.0, 0.0, 0.12)  # in the box's frame
_OFF = 0.005  # metres: a shoe this far off the ground is held
_SLOW = 0.05  # m/s
# Half extents of the box with its lip, as if that stood out on both sides.
_ROOM = (model.BOX_HALF[0], model.HINGE[1] + model.LIP[1] + 0.006)


def task() -> Task:
    """The task; `shoes_in_box` makes the environment."""
    return Task(
        things=("box", "lid", "shoe A", "shoe B"), stages=("lid open", "shoe A in", "shoe B in"),
        scene=model.scene(), home=_HOME, start=_start, boxes=_boxes, progress=_progress,
        episode_length=300, by_boxes=stages.stages,
    )  # fmt: skip


def shoes_in_box(*, varied_starts: float = 0.0, **options) -> Tabletop:
    """The environment; other `options` are those of `Tabletop`.

    `varied_starts` is the share of the episodes that begin within one of a scripted expert, which
    is played first (10 s on 2 CPU cores).
    """
    found = _moments() if varied_starts else None
    return Tabletop(task(), varied_starts=varied_starts, moments=found, **options)


# What is compiled for an environment serves as long as it does.
_demonstrated = functools.lru_cache(maxsize=1)(shoes_in_box)


@functools.cache
def _moments() -> Moments:
    """Moments of the expert, recorded once a process: they depend on no option of an episode."""
    return moments(Tabletop(task()), expert.perform)


def demonstrate(
    make: Callable[..., Tabletop], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted; a `gril_jax.envs.base.Demonstrate`.

    The expert plays with the task's own settings: whatever options a policy has, the demonstrations
    stay the same.
    """
    del make
    shown = Expert(expert.KINDS, expert.play, expert.as_meant)
    return record(_demonstrated(jitter=JITTER[wanted.places]), shown, wanted, tell)


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_shoes = jax.random.split(key)
    places = group(key_group, jnp.array(LAYOUT), share=share)
    halves = jnp.broadcast_to(jnp.array(model.SHOE_HALF[:2]), (2, 2))
    standing = Footprint(places[:1], jnp.array([_ROOM]))
    shoes, unplaced = place(key_shoes, Footprint(places[1:], halves), standing, share=share)
    joints = jnp.concatenate([jnp.zeros(1), free_joint(shoes, model.SHOE_HALF[2])])
    return Start(joints, free_joint(places[:1], 0.0)[None], unplaced)


def _box_frame(view: View) -> Frame:
    return Frame(view.fixtures[0, :3], rotation(view.fixtures[0, 3:]))


def _boxes(view: View) -> Boxes:
    base, angle = _box_frame(view), view.joints[0]
    c, s, one, zero = jnp.cos(angle), jnp.sin(angle), jnp.ones(()), jnp.zeros(())
    turn = jnp.stack([one, zero, zero, zero, c, -s, zero, s, c]).reshape(3, 3)
    hinge = Frame(out_of(base, jnp.array(model.HINGE)), compose(base.rotation, turn))
    shoes = view.joints[1:].reshape(2, 7)
    found = [
        box(base, (0.0, 0.0, model.RIM / 2), model.BOX_HALF),
        box(hinge, model.LID_CENTER, model.LID_HALF),
        *(box(Frame(s[:3], rotation(s[3:])), (0.0, 0.0, 0.0), model.SHOE_HALF) for s in shoes),
    ]
    return stacked(found)


def _progress(view: View, things: Boxes) -> StageProgress:
    base, shoes = _box_frame(view), Boxes(*(x[2:] for x in things))
    inside = jax.vmap(functools.partial(_inside, base))(shoes.position)
    released = jax.vmap(functools.partial(free, view.pads))(shoes)
    speed = jnp.sqrt(jnp.sum(view.rates[1:].reshape(2, 6)[:, :3] ** 2, axis=1))
    lid_open = view.reached[0] | (view.joints[0] > _OPEN)
    done = jnp.concatenate([lid_open[None], inside & released])
    carrying = _carrying(view, base, shoes, inside, released)
    within = jnp.where(lid_open, carrying, _opening(view, things))
    return StageProgress(done, within, (done[1:] & (speed < _SLOW)).all())


def _inside(base: Frame, position: Float[Array, "3"]) -> Bool[Array, ""]:
    x, y, z = into(base, position)
    half_x, half_y = model.FLOOR_HALF
    return (jnp.abs(x) < half_x) & (jnp.abs(y) < half_y) & (z < _BELOW_RIM)


def _opening(view: View, things: Boxes) -> Float[Array, ""]:
    """Progress of the first stage."""
    lid = Frame(things.position[1], things.rotation[1])
    lip = out_of(lid, jnp.array(model.LIP) - jnp.array(model.LID_CENTER))
    turned = jnp.clip(view.joints[0] / _OPENED, 0.0, 1.0)
    return 0.25 * closeness(view.hand.position, lip) + 0.75 * turned


def _carrying(view: View, base: Frame, shoes: Boxes, inside, released) -> Float[Array, ""]:
    """Progress of the later stages, for the shoe outside that is nearer to the box."""
    goal = out_of(base, jnp.array(_DROP))
    distance = jnp.sum((shoes.position - base.position)[:, :2] ** 2, axis=1)
    current = jnp.argmin(jnp.where(inside & released, jnp.inf, distance))
    shoe = Boxes(*(x[current] for x in shoes))
    gripped = jax.vmap(touching, in_axes=(0, None))(view.pads, shoe).all()
    held = (gripped & (lowest(shoe) > _OFF)).astype(jnp.float32)
    way = jnp.where(inside[current], 1.0, held * closeness(shoe.position, goal))
    return (
        0.2 * closeness(view.hand.position, shoe.position)
        + 0.2 * held + 0.4 * way + 0.2 * inside[current]
    )  # fmt: skip
