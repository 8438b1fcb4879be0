"""A hand-written expert for MatchRegions: the source of demonstrations, and of failed attempts.

It sees the simulator's state and is a pure function, so that hundreds of demonstrations run under
one vmap. For each block of its plan it drives to where it can take hold of it, docks, brings the
block to its place, lets go and backs off. A gripper holds the block between the tips of its
fingers and carries it any way; a stick stands behind the block and pushes. A block that slips away
is fetched again, and a distractor that got into the region is taken out.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import scripted_plans
from .base import State
from .grid_planning import Obstacles, cost_to_go, waypoint
from .match_regions import MatchRegions
from .scripted_docks import Hold, choose_dock, grip_hold, push_hold
from .scripted_plans import FAILURES, Job, Plan, Style, plan

__all__ = ["FAILURES", "Memory", "Plan", "Style", "act", "init", "plan", "rollout"]

GO, DOCK, CLOSE, CARRY, OPEN, BACK = range(6)  # phases of one job
import os
CT=float(os.environ.get('CT','1.2'));OT=float(os.environ.get('OT','0.8'))
_CARRY_TIME = 50  # control steps after which a way that leads nowhere is given up


class Memory(NamedTuple):
    """The expert's own state."""

    plan: Plan
    job: Job
    dock: Float[Array, "2"]  # unit vector along which to drive up to the block
    grips: Bool[Array, ""]  # and whether to grip it there, or to push
    phase: Int[Array, ""]
    timer: Int[Array, ""]  # control steps since the phase began
    stuck: Int[Array, ""]  # control steps that the robot has tried to move, and did not
    time: Int[Array, ""]


class _View(NamedTuple):
    """What the expert sees of a moment, for its present job."""

    robot: Float[Array, "2"]
    yaw: Float[Array, ""]
    blocks: Float[Array, "B 2"]
    block: Float[Array, "2"]
    other: Bool[Array, "B"]  # blocks other than the job's
    distance: Float[Array, ""]  # from the robot to the job's block
    ahead: Float[Array, ""]  # by how much to turn to face it
    aside: Float[Array, ""]  # of the block, to the right of the robot's axis
    moves: Bool[Array, ""]  # the robot drives or turns


def init(drawn: Plan) -> Memory:
    """An expert about to begin its plan."""
    zero = jnp.zeros((), jnp.int32)
    nowhere = jnp.zeros(2)
    return Memory(drawn, scripted_plans.first_job(drawn), nowhere, zero > 0, zero, zero, zero, zero)


def act(env: MatchRegions, memory: Memory, state: State) -> tuple[Float[Array, "A"], Memory]:
    """The expert's action for this moment, and what it remembers."""
    seen = _look(env, memory.job, state)
    drawn, job, phase = memory.plan, memory.job, memory.phase
    at = jnp.minimum(job.stage, len(drawn.blocks) - 1)
    waiting = (phase == GO) & (memory.timer < drawn.pauses[at])
    done = job.stage >= len(drawn.blocks)
    idle = done | (memory.time >= drawn.steps) | waiting

    star = state.data.shape[job.block] == 0
    ahead = _block_way(env, seen, job)
    dock, grips = choose_dock(
        env.robot, seen.robot, seen.block, seen.blocks, seen.other, ahead, memory.dock,
        memory.grips, star, arena=env.arena,
    )  # fmt: skip
    dock = jnp.where(phase == GO, dock, memory.dock)
    grips = jnp.where(phase == GO, grips, memory.grips)
    how = push_hold(env.robot)
    if env.robot.has_fingers:
        how = jax.tree.map(lambda g, p: jnp.where(grips, g, p), grip_hold(star), how)
    aim, roaming = _aim(env, how, seen, memory, job, dock, at)
    speed, turn, grip = _drive(how, seen, memory, aim, ahead, job, dock, roaming)
    fastest = jnp.stack([2.5, 2.5, 0.0, CT, OT, 2.5])[phase]  # a held block swings out
    rate = jnp.clip(6.0 * turn, -fastest, fastest) / env.turn_gain
    if env.robot.has_fingers:
        opening = (state.data.pose[1, 2] - state.data.pose[2, 2]) / 2
        firm = np.pi / 8 - (opening - float(os.environ.get("EPS", "0.01")))
        grip = jnp.where((phase == CARRY), jnp.clip(firm, 0.0, 1.0), grip)
    action = jnp.stack([speed, rate, grip])
    action = jnp.where(idle, jnp.array([0.0, 0.0, -1.0]), action)[: env.action_size]

    leave, to = _leave(how, seen, memory, job, dock, ahead, roaming)
    leave &= ~idle
    following = scripted_plans.next_job(env, drawn, job, state)
    # With the last block in place it just lets go.
    finished = leave & (to == BACK) & (following.stage >= len(drawn.blocks))
    to = jnp.where(finished, GO, to)
    ended = leave & (to == GO)
    following = jax.tree.map(lambda new, old: jnp.where(ended, new, old), following, job)
    # A block that slipped away is the same job again, with a fresh look at how to take it.
    return action, Memory(
        plan=drawn._replace(via_steps=jnp.where(roaming | ~leave, drawn.via_steps,
                                                drawn.via_steps.at[at].set(0))),  # fmt: skip
        job=following,
        dock=jnp.where(ended, 0.0, dock),
        grips=grips,
        phase=jnp.where(leave, to, phase).astype(jnp.int32),
        timer=jnp.where(leave, 0, memory.timer + 1).astype(jnp.int32),
        stuck=jnp.where(leave | seen.moves | idle, 0, memory.stuck + 1).astype(jnp.int32),
        time=memory.time + 1,
    )


def rollout(
    env: MatchRegions,
    key: PRNGKeyArray,
    failure: Int[Array, ""] | int = 0,
    style: Style = Style(),  # noqa: B008 -- a tuple of numbers
) -> tuple[State, Int[Array, "T1"]]:
    """One episode: states of T + 1 moments (the first is the reset), and the stage at each."""
    key_reset, key_plan = jax.random.split(key)
    state = env.reset(key_reset)
    memory = init(plan(env, key_plan, state, failure, style))

    def move(carry, _):
        state, memory = carry
        action, memory = act(env, memory, state)
        state = env.step(state, action)
        return (state, memory), (state, memory.job.stage)

    _, (states, stages) = jax.lax.scan(move, (state, memory), length=env.episode_length)
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), state, states)
    return states, jnp.concatenate([memory.job.stage[None], stages])


# ---------------------------------------------------------------- parts of `act`


def _look(env: MatchRegions, job: Job, state: State) -> _View:
    pose, velocity = state.data.pose, state.data.velocity[0]
    robot, yaw = pose[0, :2], pose[0, 2]
    blocks = pose[-len(env.blocks) :, :2]
    block = blocks[job.block]
    away = block - robot
    return _View(
        robot=robot,
        yaw=yaw,
        blocks=blocks,
        block=block,
        other=jnp.arange(len(env.blocks)) != job.block,
        distance=jnp.sqrt(jnp.sum(away**2) + 1e-12),
        ahead=_bearing(away, yaw),
        aside=away[0] * jnp.cos(yaw) + away[1] * jnp.sin(yaw),
        moves=(jnp.abs(velocity[:2]).max() > 0.04) | (jnp.abs(velocity[2]) > 0.3),
    )


def _wrap(angle: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))


def _bearing(away: Float[Array, "2"], yaw: Float[Array, ""]) -> Float[Array, ""]:
    """Angle by which to turn, counter-clockwise, so as to face along a vector."""
    return _wrap(jnp.arctan2(-away[0], away[1]) - yaw)


def _unit(vector: Float[Array, "2"]) -> Float[Array, "2"]:
    return vector / jnp.maximum(jnp.sqrt(jnp.sum(vector**2) + 1e-12), 1e-6)


def _block_way(env: MatchRegions, seen: _View, job: Job) -> Float[Array, "2"]:
    """Which way the block should move now: towards its place, around the other blocks."""
    width = jnp.minimum(push_hold(env.robot).width, 0.3)
    radius = jnp.where(seen.other, 0.3 + 0.5 * width, 0.0)
    obstacles = Obstacles(seen.blocks, radius, jnp.float32(env.arena - 0.2))
    extent = env.arena - 0.1
    cost = cost_to_go(job.slot, obstacles, extent=extent)
    return _unit(waypoint(seen.block, job.slot, cost, obstacles, extent=extent) - seen.block)


def _aim(env, how, seen, memory, job, dock, at) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
    """Where the robot heads, and whether it is on its plan's detour."""
    drawn = memory.plan
    roaming = (memory.phase == GO) & (memory.timer < drawn.pauses[at] + drawn.via_steps[at])
    carries = memory.phase == CARRY
    target = jnp.where(carries, job.slot, seen.block - how.stand * dock)
    target = jnp.where(roaming, drawn.via[at], target)
    # On its way it keeps clear of the job's block too; with it in hand, of what it may sweep along.
    radius = jnp.where(carries, how.body + 0.26, how.body + 0.24)
    own = jnp.where(carries, 0.0, jnp.minimum(how.stand, 0.55))
    radius = jnp.where(seen.other, jnp.minimum(radius, 0.5), own)
    radius = jnp.where(roaming & drawn.bumps[at], 0.0, radius)
    obstacles = Obstacles(seen.blocks, radius, env.arena - (0.4 if env.robot.has_fingers else jnp.minimum(how.body, 0.3) + 0.03))
    extent = env.arena - 0.1
    cost = cost_to_go(target, obstacles, extent=extent)
    return waypoint(seen.robot, target, cost, obstacles, extent=extent), roaming


def _drive(how, seen, memory, aim, ahead, job, dock, roaming):
    """Forward speed, angle to turn by and grip of the present phase."""
    phase, timer = memory.phase, memory.timer
    to_aim = aim - seen.robot
    turn = _bearing(to_aim, seen.yaw)
    facing = jnp.clip(1.0 - jnp.abs(turn) / 1.0, 0.0, 1.0)
    near = jnp.sqrt(jnp.sum(to_aim**2))
    go = facing * jnp.clip(6.0 * near, 0.2, 0.8)
    # Arrived at where it docks from, it turns to the block.
    stand = seen.block - how.stand * dock
    there = jnp.sqrt(jnp.sum((seen.robot - stand) ** 2)) < 0.1
    face = there & ~roaming
    go = jnp.where(face, 0.0, go)
    go_turn = jnp.where(face, seen.ahead, turn)

    straight = jnp.clip(1.0 - 2.5 * jnp.abs(seen.ahead), 0.0, 1.0)
    seat = jnp.clip(4.0 * (seen.distance - how.reach), jnp.where(how.grips, -0.4, 0.25), 0.6)
    left = jnp.sqrt(jnp.sum((job.slot - seen.block) ** 2) + 1e-12)
    # A gripped block comes along whichever way the robot goes. Turning on the spot is slow with
    # it in hand, and at a wall it wedges: back off.
    short = jnp.sqrt(jnp.sum((job.slot - seen.robot) ** 2) + 1e-12) - seen.distance
    bend = 0.8 * jnp.clip(1.0 - jnp.abs(turn) / 0.7, -0.3, 1.0)
    final = jnp.clip(6.0 * short, -0.4, 0.6) * jnp.clip(1.0 - jnp.abs(turn) / 0.7, 0.2, 1.0)
    carry = jnp.where(short < 0.25, final, bend)
    # A pushed one goes where the robot heads, and slips off in a sharp bend.
    error = _bearing(ahead, seen.yaw)
    push = jnp.clip(6.0 * left, 0.2, 0.8) * jnp.clip(1.2 - jnp.abs(error), 0.3, 1.0)
    push_turn = 0.5 * error
    # A block that comes along when the robot backs off is wedged between the fingers: shake it.
    stuck = how.grips & (phase == BACK) & (seen.distance < 0.45) & (timer >= 2)
    beat = timer % 4
    shake = jnp.where(stuck, jnp.where(beat < 2, 1.0, -1.0), how.grips * seen.ahead)
    back = jnp.where(stuck & (beat == 3), 0.3, -0.8)

    speeds = jnp.stack([go, seat * straight, 0.0, jnp.where(how.grips, carry, push), 0.0, back])
    turns = jnp.stack(
        [go_turn, seen.ahead, 0.0, jnp.where(how.grips, turn, push_turn), seen.ahead, shake]
    )
    # Fingers are open only to let a block in or out, and while the robot drives freely.
    closed = jnp.where(how.grips, (phase == CLOSE) | (phase == CARRY), True)
    return speeds[phase], turns[phase], jnp.where(closed, 1.0, -1.0)


def _leave(how, seen, memory, job, dock, ahead, roaming):
    """Whether the present phase ends, and which follows."""
    phase, timer = memory.phase, memory.timer
    stand = seen.block - how.stand * dock
    off = jnp.sqrt(jnp.sum((seen.robot - stand) ** 2))
    lined = jnp.abs(seen.ahead) < 0.3
    heading = jnp.stack([-jnp.sin(seen.yaw), jnp.cos(seen.yaw)])
    behind = _unit(seen.block - seen.robot) @ dock > jnp.where(how.grips, 0.8, 0.97)
    close = seen.distance < how.stand + 0.1
    left = jnp.sqrt(jnp.sum((job.slot - seen.block) ** 2) + 1e-12)
    short = jnp.sqrt(jnp.sum((job.slot - seen.robot) ** 2) + 1e-12) - seen.distance
    docked = (seen.distance < how.reach + 0.03) & (jnp.abs(seen.aside) < how.width)
    passed = (ahead @ heading < 0) & (left < 0.12)
    arrived = (left < 0.05) | jnp.where(
        how.grips, (left < 0.1) & (jnp.abs(short) < 0.04), passed
    )
    slid = jnp.abs(seen.aside) > how.width + 0.02
    lost = slid | (seen.distance > how.reach + 0.15)
    lost |= ~how.grips & (heading @ ahead < 0.6)
    # It did not come off: carry it on as it is.
    still = how.grips & (phase == GO) & (seen.distance < how.reach + 0.04)
    still &= (jnp.abs(seen.aside) < how.width) & ~roaming
    missed = (seen.distance > how.stand + 0.15) | (timer > 25)
    dropped = ~memory.plan.retry & (job.stage == len(memory.plan.blocks) - 1)
    dropped &= timer >= memory.plan.drop
    given_up = arrived | lost | dropped | (timer > _CARRY_TIME)
    ends = jnp.stack(
        [
            (((off < 0.1) | behind & close) & ~roaming) & lined | (timer > 70),
            docked | missed,
            timer >= jnp.where(how.grips, 4, 0),
            given_up,
            timer >= jnp.where(how.grips, 4, 0),
            (seen.distance > how.stand - 0.05) & (timer >= 3) | (timer >= jnp.where(how.grips, 14, 7)),
        ]
    )
    ends = ends.at[GO].set(ends[GO] | still)
    onward = jnp.stack([jnp.where(still, CLOSE, DOCK), jnp.where(missed, GO, CLOSE), CARRY, OPEN, BACK, GO])
    # Caught on something: back off and look again.
    caught = (memory.stuck >= 5) & ((phase == GO) | (phase == DOCK) | (phase == CARRY))
    return ends[phase] | caught, jnp.where(caught & ~ends[phase], BACK, onward[phase])
