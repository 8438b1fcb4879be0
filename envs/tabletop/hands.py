"""The arm at a place where a picture shows its hand, clear of all that the hand does not hold."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.frames import Frame, about_z
from jaxtyping import Array, Bool, Float

from . import boxes
from .boxes import Boxes
from .from_boxes import Grip, Layout
from .start import Start

_DOWN = np.array([1.0, -1.0, -1.0], np.float32)  # columns of a rotation whose z points down
_LIFTS = np.arange(0.0, 0.4, 0.01, np.float32)  # metres, of which the least is taken that is clear
_ROUNDS = 6  # of the joints' search
_NEAR = 0.01  # metres: a hand that comes no nearer is out of reach
_LOWEST = 0.012  # metres: of the tool centre point above the table


def at(
    home: Float[Array, "7"],
    start: Start,
    grip: Grip,
    layout: Layout,
    things: Callable[[Array, Array], Boxes],
) -> tuple[Start, Float[Array, "7"], Bool[Array, ""]]:
    """The start with what is held lifted as far as the hand, the arm, and whether it gets there.

    The hand goes no further down than to where it, and what it holds, touch nothing.
    """
    all_things = things(start.joints, start.fixtures)
    first, count = len(all_things.half) - len(layout.loose), len(layout.loose)
    is_held = jnp.arange(len(all_things.half)) == jnp.where(grip.held < 0, -1, first + grip.held)
    known = jnp.isfinite(grip.place).all() & jnp.isfinite(grip.yaw)
    place = jnp.where(known, grip.place, jnp.array([0.5, 0.0, 0.4]))
    place = place.at[2].max(_LOWEST)

    def hand(lift, down=0.0):
        turn = about_z(jnp.where(known, grip.yaw, 0.0)) * _DOWN
        return Frame(place.at[2].add(lift + down), turn)

    def clear(lift):
        robot = boxes.robot(hand(lift, kinematics.TCP), grip.opening, grip.opening)
        moved = all_things.position.at[:, 2].add(lift)
        touches = jax.vmap(jax.vmap(boxes.touching, in_axes=(None, 0)), in_axes=(0, None))
        by_robot = touches(robot, all_things) & ~is_held
        by_held = touches(all_things._replace(position=moved), all_things)
        by_held &= is_held[:, None] & ~is_held
        return ~(by_robot.any() | by_held.any())

    free = jax.vmap(clear)(jnp.asarray(_LIFTS))
    lift = jnp.asarray(_LIFTS)[jnp.argmax(free)]
    goal = hand(lift)
    arm = jax.lax.fori_loop(0, _ROUNDS, lambda _, q: kinematics.reach(q, goal, rest=home), home)
    near = jnp.linalg.norm(kinematics.tcp(arm).position - goal.position) < _NEAR
    known &= near & free.any()
    rails = len(layout.rails)
    held = jnp.arange(count) == grip.held
    loose = start.joints[rails:].reshape(count, 7)
    loose = loose.at[:, 2].add(jnp.where(held, lift, 0.0))
    joints = jnp.concatenate([start.joints[:rails], loose.reshape(-1)])
    return start._replace(joints=joints), arm, known
