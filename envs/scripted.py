"""A hand-written expert for MatchRegions: the source of demonstrations, and of failed attempts.

It sees the simulator's state and is a pure function, so that hundreds of demonstrations run under
one vmap. For each block of its plan it drives up (around what is in the way), closes the fingers,
carries the block to its place in the region, opens, and backs off; a block that slips away is
fetched again.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .base import State
from .match_regions import MatchRegions

__all__ = ["FAILURES", "Memory", "Plan", "act", "init", "plan", "rollout"]

GO, CLOSE, CARRY, OPEN, BACK = range(5)  # phases of one stage
FAILURES = ("none", "stops_early", "wrong_block", "wrong_place")
_HOLD = 0.32  # from the robot's centre to that of a held block
_REACH = 0.37  # close enough to seat the block between the fingers


class Plan(NamedTuple):
    """What one episode's expert intends; K stages."""

    blocks: Int[Array, "K"]  # which block each stage brings
    slots: Float[Array, "K 2"]  # where to
    pauses: Int[Array, "K"]  # control steps to wait before each stage
    steps: Int[Array, ""]  # stand still from this control step on
    retry: Bool[Array, ""]  # fetch again what is not in the region


class Memory(NamedTuple):
    """The expert's own state."""

    plan: Plan
    stage: Int[Array, ""]
    phase: Int[Array, ""]
    timer: Int[Array, ""]  # control steps since the phase began
    time: Int[Array, ""]


def plan(
    env: MatchRegions, key: PRNGKeyArray, state: State, failure: Int[Array, ""] | int = 0
) -> Plan:
    """Draw an order of targets, their places and pauses; `failure` indexes `FAILURES`."""
    keys = jax.random.split(key, 6)
    k, goal = env.num_targets, state.data.goal
    order = jax.random.permutation(keys[0], k)
    blocks = state.data.pose[3:, :2]
    away = goal[:2] - blocks[order]
    along = away / jnp.maximum(jnp.linalg.norm(away, axis=1, keepdims=True), 1e-6)
    # The first block goes deep into the region, so that the next finds room behind it.
    depth = jnp.linspace(0.12, -0.14, k) if k > 1 else jnp.zeros(1)
    noise = 0.04 * jax.random.normal(keys[1], (k, 2))
    reach = goal[2:] / 2 - 0.1
    slots = goal[:2] + jnp.clip(depth[:, None] * along + noise, -reach, reach)

    angle = jax.random.uniform(keys[2], (), maxval=2 * jnp.pi)
    aside = goal[:2] + 0.75 * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    aside = jnp.clip(aside, -0.75 * env.arena, 0.75 * env.arena)
    wrong_place = failure == FAILURES.index("wrong_place")
    slots = slots.at[-1].set(jnp.where(wrong_place, aside, slots[-1]))
    wrong_block = failure == FAILURES.index("wrong_block")
    other = jax.random.randint(keys[3], (), k, max(len(env.blocks), k + 1))
    other = jnp.minimum(other, len(env.blocks) - 1)
    order = order.at[-1].set(jnp.where(wrong_block, other, order[-1]))
    cut = jax.random.randint(keys[4], (), 8, 40)
    steps = jnp.where(failure == FAILURES.index("stops_early"), cut, 10_000)
    pauses = jax.random.randint(keys[5], (k,), 0, 3)
    return Plan(order, slots, pauses, steps, jnp.asarray(failure == 0))


def init(drawn: Plan) -> Memory:
    """An expert about to begin its plan."""
    zero = jnp.zeros((), jnp.int32)
    return Memory(drawn, zero, zero, zero, zero)


def _wrap(angle: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))


def _bearing(origin: Float[Array, "2"], yaw: Float[Array, ""], point: Float[Array, "2"]):
    """Angle by which to turn, counter-clockwise, so as to face a point."""
    away = point - origin
    return _wrap(jnp.arctan2(-away[0], away[1]) - yaw)


def _gap(start: Float[Array, "2"], end: Float[Array, "2"], points: Float[Array, "M 2"]):
    """Distance of each point to a segment."""
    way = end - start
    share = (points - start) @ way / jnp.maximum(way @ way, 1e-9)
    nearest = start + jnp.clip(share, 0.0, 1.0)[:, None] * way
    return jnp.sqrt(jnp.sum((points - nearest) ** 2, axis=1) + 1e-12)


def detour(
    start: Float[Array, "2"],
    yaw: Float[Array, ""],
    end: Float[Array, "2"],
    obstacles: Float[Array, "M 2"],
    counts: Bool[Array, "M"],
    *,
    clearance: float,
    limit: float,
) -> Float[Array, "2"]:
    """Where to head now: the end itself, or the best single way point on a grid of 13 x 13.

    The cost of a way point is the length of both legs, a penalty for each obstacle that a leg
    passes closer than `clearance`, and a little for turning, so that the choice is steady.
    """
    axis = jnp.linspace(-limit, limit, 13)
    grid = jnp.stack(jnp.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    via = jnp.concatenate([end[None], grid])

    def cost(point):
        near = jnp.minimum(_gap(start, point, obstacles), _gap(point, end, obstacles))
        penalty = jnp.sum(jnp.where(counts, jnp.maximum(clearance - near, 0.0), 0.0))
        turn = jnp.abs(_bearing(start, yaw, point))
        length = jnp.linalg.norm(point - start) + jnp.linalg.norm(end - point)
        close = jnp.linalg.norm(point - start) < 0.15
        return length + 8.0 * penalty + 0.1 * turn + jnp.where(close, 10.0, 0.0)

    costs = jax.vmap(cost)(via).at[0].add(-0.1)
    return via[jnp.argmin(costs)]


def act(env: MatchRegions, memory: Memory, state: State) -> tuple[Float[Array, "3"], Memory]:
    """The expert's action for this moment, and what it remembers."""
    drawn, stage, phase = memory.plan, memory.stage, memory.phase
    last = len(drawn.blocks)
    at = jnp.minimum(stage, last - 1)
    which, slot = drawn.blocks[at], drawn.slots[at]
    pose = state.data.pose
    robot, yaw = pose[0, :2], pose[0, 2]
    blocks = pose[3:, :2]
    block = blocks[which]
    ahead = _bearing(robot, yaw, block)
    distance = jnp.linalg.norm(block - robot)

    others = jnp.arange(len(env.blocks)) != which
    limit = env.arena - 0.25
    near = distance < 0.6
    go = jnp.where(
        near, block, detour(robot, yaw, block, blocks, others, clearance=0.42, limit=limit)
    )
    distractors = others & (jnp.arange(len(env.blocks)) >= env.num_targets)
    carry = detour(robot, yaw, slot, blocks, distractors, clearance=0.5, limit=limit)
    carry = jnp.where(jnp.linalg.norm(slot - robot) < 0.6, slot, carry)

    aim = jnp.where(phase == CARRY, carry, go)
    turn = _bearing(robot, yaw, aim)
    wide = jnp.where(phase == CARRY, 0.6, 1.0)  # turns while it drives, more boldly without a block
    facing = jnp.clip(1.0 - jnp.abs(turn) / wide, 0.0, 1.0)
    short = jnp.linalg.norm(slot - robot) - _HOLD  # still to go with the block in hand
    # Turning on the spot would shake the block off; at a wall, creeping on would wedge it there.
    at_wall = jnp.abs(block).max() > env.arena - 0.25
    creep = jnp.where(at_wall & (facing < 0.2), -0.15, jnp.maximum(facing * 0.8, 0.2))
    speeds = jnp.stack(
        [
            facing * 0.8,
            0.3,  # pushes the block against the disc before and while the fingers close
            jnp.where(short < 0.3, facing * jnp.clip(5 * short, -0.5, 0.8), creep),
            0.0,
            -0.8,
        ]
    )
    # While letting go, face the block: the bent finger on its other side would drag it along.
    turns = jnp.where((phase == GO) | (phase == CARRY), turn, jnp.where(phase >= OPEN, ahead, 0.0))
    # A block that comes along when the robot backs off is wedged between the fingers: shake it.
    stuck = (phase == BACK) & (distance < 0.45) & (memory.timer >= 2)
    beat = memory.timer % 4
    turns = jnp.where(stuck, jnp.where(beat < 2, 1.0, -1.0), turns)
    speeds = speeds.at[BACK].set(jnp.where(stuck & (beat == 3), 0.3, -0.8))
    grip = jnp.where(((phase == CLOSE) & (memory.timer >= 2)) | (phase == CARRY), 1.0, -1.0)
    fastest = jnp.where(phase == CARRY, 2.2, 2.5)
    rate = jnp.clip(6.0 * turns, -fastest, fastest)
    action = jnp.stack([speeds[phase], rate / env.turn_gain, grip])
    waiting = (phase == GO) & (memory.timer < drawn.pauses[at])
    idle = (stage >= last) | (memory.time >= drawn.steps) | waiting
    action = jnp.where(idle, jnp.array([0.0, 0.0, -1.0]), action)

    arrived = (jnp.linalg.norm(block - slot) < 0.08) | ((short < 0.04) & (jnp.abs(turn) < 0.2))
    lost = (distance > 0.52) | (jnp.abs(ahead) > 0.7)
    leave = (
        jnp.stack(
            [
                (distance < _REACH) & (jnp.abs(ahead) < 0.25),
                memory.timer >= 4,
                arrived | lost,
                memory.timer >= 4,
                (distance > 0.6) | (memory.timer >= 12),
            ]
        )[phase]
        & ~idle
    )
    onward = (phase + 1) % 5
    ended = leave & (phase == BACK)
    inside = (jnp.abs(blocks - state.data.goal[:2]) <= state.data.goal[2:] / 2 - 0.02).all(axis=1)
    missing = ~inside[drawn.blocks]
    again = jnp.where(missing.any(), jnp.argmax(missing), last)
    following = jnp.where(drawn.retry, again, stage + 1)
    return action, Memory(
        plan=drawn,
        stage=jnp.where(ended, following, stage).astype(jnp.int32),
        phase=jnp.where(leave, onward, phase).astype(jnp.int32),
        timer=jnp.where(leave, 0, memory.timer + 1).astype(jnp.int32),
        time=memory.time + 1,
    )


def rollout(
    env: MatchRegions, key: PRNGKeyArray, failure: Int[Array, ""] | int = 0
) -> tuple[State, Int[Array, "T1"]]:
    """One episode: states of T + 1 moments (the first is the reset), and the stage at each."""
    key_reset, key_plan = jax.random.split(key)
    state = env.reset(key_reset)
    memory = init(plan(env, key_plan, state, failure))

    def move(carry, _):
        state, memory = carry
        action, memory = act(env, memory, state)
        state = env.step(state, action)
        return (state, memory), (state, memory.stage)

    _, (states, stages) = jax.lax.scan(move, (state, memory), length=env.episode_length)
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), state, states)
    return states, jnp.concatenate([memory.stage[None], stages])
