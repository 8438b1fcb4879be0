"""The phases of a gripper expert's job in MatchRegions, and when each ends.

GO drives to where the robot docks from, DOCK up to the block, CLOSE shuts the fingers, CARRY brings
the block to its place, OPEN lets go and BACK drives off.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from . import ways
from .plans import Job
from .task import MatchRegions

GO, DOCK, CLOSE, CARRY, OPEN, BACK = range(6)
_CARRY_TIME = 50  # control steps after which a way that leads nowhere is given up
_GO_TIME = 70
_STUCK = 8  # control steps without motion
# Fastest turn of each phase, rad/s: a block in hand swings out of a faster one.
_FASTEST = np.array([2.5, 2.5, 0.0, 1.2, 0.8, 2.5], np.float32)


class View(NamedTuple):
    """The scene as an expert sees it, for its present job."""

    robot: Float[Array, "2"]
    yaw: Float[Array, ""]
    blocks: Float[Array, "B 2"]
    block: Float[Array, "2"]  # the job's
    other: Bool[Array, "B"]  # blocks other than that
    distance: Float[Array, ""]  # from the robot to the job's block
    ahead: Float[Array, ""]  # by how much to turn to face it
    aside: Float[Array, ""]  # of the block, to the right of the robot's axis
    opening: Float[Array, ""]  # of the fingers, rad
    job: Job
    phase: Int[Array, ""]
    timer: Int[Array, ""]  # control steps since the phase began
    stuck: Int[Array, ""]  # control steps that the robot has not moved


def bearing(away: Float[Array, "2"], yaw: Float[Array, ""]) -> Float[Array, ""]:
    """Angle to turn by, counter-clockwise, to face along a vector."""
    angle = jnp.arctan2(-away[0], away[1]) - yaw
    return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))


def unit(vector: Float[Array, "2"]) -> Float[Array, "2"]:
    """Unit vector of the same direction; zero for the zero vector."""
    return vector / jnp.maximum(jnp.sqrt(jnp.sum(vector**2) + 1e-12), 1e-6)


def aim(env: MatchRegions, seen: View, stand: Float[Array, "2"]) -> Float[Array, "2"]:
    """The point that the robot heads for: to dock, or the block's place."""
    carries = seen.phase == CARRY
    target = jnp.where(carries, seen.job.slot, stand)
    # On its way it keeps clear of the job's block too; with it in hand, of what it may sweep along.
    radius = jnp.minimum(ways.BODY + jnp.where(carries, 0.26, 0.24), 0.5)
    radius = jnp.where(seen.other, radius, jnp.where(carries, 0.0, ways.BERTH))
    obstacles = ways.Obstacles(seen.blocks, radius, jnp.float32(env.arena - 0.4))
    extent = env.arena - 0.1
    cost = ways.cost_to_go(target, obstacles, extent=extent)
    return ways.waypoint(seen.robot, target, cost, obstacles, extent=extent, near=0.4)


def drive(
    seen: View, aim: Float[Array, "2"], stand: Float[Array, "2"]
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Desired forward speed (units/s), turn (rad/s) and finger opening (rad).

    `aim` is what that function gives, `stand` where the robot turns to the block before it drives
    up to it.
    """
    turn = bearing(aim - seen.robot, seen.yaw)
    facing = jnp.clip(1.0 - jnp.abs(turn), 0.0, 1.0)
    go = facing * jnp.clip(6.0 * _length(aim - seen.robot), 0.2, 0.8)
    there = _length(seen.robot - stand) < 0.1
    go, go_turn = jnp.where(there, 0.0, go), jnp.where(there, seen.ahead, turn)

    straight = jnp.clip(1.0 - 2.5 * jnp.abs(seen.ahead), 0.0, 1.0)
    seat = straight * jnp.clip(6.0 * (seen.distance - ways.REACH), -0.4, 0.8)
    # A block that comes along when the robot backs off is wedged between the fingers: shake it.
    wedged, beat = (seen.distance < 0.45) & (seen.timer >= 2), seen.timer % 4
    shake = jnp.where(wedged, jnp.where(beat < 2, 1.0, -1.0), seen.ahead)
    back = jnp.where(wedged & (beat == 3), 0.3, -0.8)
    speed = jnp.stack([go, seat, 0.0, _carry(seen, turn), 0.0, back])[seen.phase]
    turns = jnp.stack([go_turn, seen.ahead, 0.0, turn, seen.ahead, shake])
    fastest = jnp.asarray(_FASTEST)[seen.phase]
    # Fingers that press on hard work themselves into a star; they hold as well where they are.
    firm = jnp.where(seen.phase == CARRY, seen.opening - 0.01, 0.0)
    opening = jnp.where((seen.phase == CLOSE) | (seen.phase == CARRY), firm, 1.0)
    return speed, jnp.clip(6.0 * turns[seen.phase], -fastest, fastest), opening


def _carry(seen: View, turn: Float[Array, ""]) -> Float[Array, ""]:
    """Speed while carrying a block."""
    short = _length(seen.job.slot - seen.robot) - seen.distance
    # Turning on the spot is slow with the block in hand, and at a wall it wedges: back off.
    bend = 0.8 * jnp.clip(1.0 - jnp.abs(turn) / 0.7, -0.3, 1.0)
    final = jnp.clip(6.0 * short, -0.4, 0.6) * jnp.clip(1.0 - jnp.abs(turn) / 0.7, 0.2, 1.0)
    return jnp.where(short < 0.25, final, bend)


def leave(
    seen: View,
    dock: Float[Array, "2"],
    stand: Float[Array, "2"],
    dropped: Bool[Array, ""],
) -> tuple[Bool[Array, ""], Int[Array, ""]]:
    """True if the present phase ends, and the one that follows. Arguments as for `drive`.

    `dropped` is true from when a plan lets its block go on the way.
    """
    timer, width = seen.timer, jnp.abs(seen.aside)
    behind = unit(seen.block - seen.robot) @ dock > 0.8
    at_stand = (_length(seen.robot - stand) < 0.1) | behind & (seen.distance < ways.STAND + 0.1)
    lined = at_stand & (jnp.abs(seen.ahead) < 0.3)
    # A block that did not come off when the robot backed away is carried on as it is.
    held, going = width < ways.WIDTH, seen.phase == GO
    still = (seen.distance < ways.REACH + 0.04) & held & going
    docked = (seen.distance < ways.REACH + 0.03) & held
    missed = (seen.distance > ways.STAND + 0.15) | (timer > 25)
    # The block in hand is at its place, or as near as going on brings it.
    left = _length(seen.job.slot - seen.block)
    short = _length(seen.job.slot - seen.robot) - seen.distance
    arrived = (left < 0.05) | (left < 0.1) & (jnp.abs(short) < 0.04)
    lost = (width > ways.WIDTH + 0.02) | (seen.distance > ways.REACH + 0.15)
    away = (seen.distance > ways.STAND - 0.05) & (timer >= 3)
    ends = [
        lined | still | (timer > _GO_TIME),
        docked | missed,
        timer >= 4,
        arrived | lost | dropped | (timer > _CARRY_TIME),
        timer >= 4,
        away | (timer >= 14),
    ]
    onward = [jnp.where(still, CLOSE, DOCK), jnp.where(missed, GO, CLOSE), CARRY, OPEN, BACK, GO]
    ended, to = jnp.stack(ends)[seen.phase], jnp.stack(onward)[seen.phase]
    # Caught on something: back off and look again.
    moving = (seen.phase == GO) | (seen.phase == DOCK) | (seen.phase == CARRY)
    caught = (seen.stuck >= _STUCK) & moving
    return ended | caught, jnp.where(caught & ~ended, BACK, to)


def _length(vector: Float[Array, "*B 2"]) -> Float[Array, "*B"]:
    """Length of a vector, with a gradient at zero."""
    return jnp.sqrt(jnp.sum(vector**2, axis=-1) + 1e-12)
