"""A scripted expert for MatchRegions: the source of demonstrations, and of failed attempts.

It sees the simulator's state and is a pure function, so that hundreds of demonstrations run under
one vmap. For each block of its plan it drives to where it can take hold of it, docks, brings the
block to its place, lets go and backs off (`phases`). What slips away is fetched again, and what
should not be in the region is taken out. It holds a block between the tips of its fingers, which a
stick cannot.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Demonstrations, Episode, ExpertError, State, Wanted
from gril_jax.envs.magical.simulator import TURN_GAIN
from gril_jax.envs.planar.robots import FINGER_OPEN
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import phases, plans
from .plans import FAILURES, Job, Plan, plan
from .task import MatchRegions
from .ways import BODY, STAND, choose_dock

_SPARE = 2  # successes played for each that is kept: the brisker half, as a person would choose
_ROUNDS = 8  # batches of episodes before giving up on an expert that fails
_AFTER = 12  # frames that a video goes on once the task is done
_STILL, _STILL_TURN = 0.004, 0.03  # units and rad a control step: slower is standing


class Memory(NamedTuple):
    """The state of a gripper expert."""

    plan: Plan
    job: Job
    dock: Float[Array, "2"]  # unit vector along which to drive up to the block; zero for none yet
    phase: Int[Array, ""]
    timer: Int[Array, ""]  # control steps since the phase began
    pose: Float[Array, "3"]  # the robot's, a control step ago
    stuck: Int[Array, ""]  # control steps that the robot has not moved
    begun: Bool[Array, ""]  # the pause before the stage is over
    time: Int[Array, ""]


def init(drawn: Plan) -> Memory:
    """Initial memory of an expert that is about to begin its plan."""
    zero = jnp.zeros((), jnp.int32)
    return Memory(
        plan=drawn, job=Job(zero, drawn.blocks[0], drawn.slots[0]), dock=jnp.zeros(2), phase=zero,
        timer=zero, pose=jnp.zeros(3), stuck=zero, begun=zero > 0, time=zero,
    )  # fmt: skip


def act(env: MatchRegions, memory: Memory, state: State) -> tuple[Float[Array, "A"], Memory]:
    """A gripper expert's action for this step, and its updated memory."""
    drawn, job, phase, timer = memory.plan, memory.job, memory.phase, memory.timer
    seen = _look(env, memory, state)
    last = len(drawn.blocks)
    at = jnp.minimum(job.stage, last - 1)
    waiting = (phase == phases.GO) & ~memory.begun & (timer < drawn.pauses[at])
    idle = (job.stage >= last) | (memory.time >= drawn.steps) | waiting

    way = phases.unit(seen.job.slot - seen.block)
    dock = choose_dock(
        seen.robot, seen.block, seen.blocks, seen.other, way, memory.dock, arena=env.arena
    )
    dock = jnp.where(phase == phases.GO, dock, memory.dock)
    limit = env.arena - BODY - 0.01
    stand = jnp.clip(seen.block - STAND * dock, -limit, limit)
    aim = phases.aim(env, seen, stand)
    speed, turn, opening = phases.drive(seen, aim, stand)
    grip = FINGER_OPEN - jnp.clip(opening, 0.0, FINGER_OPEN)
    action = jnp.where(idle, 0.0, jnp.stack([speed, turn / TURN_GAIN, grip]))

    dropped = ~drawn.retry & (job.stage == last - 1) & (timer >= drawn.drop)
    ended, to = phases.leave(seen, dock, stand, dropped)
    ended &= ~idle
    following = plans.next_job(env, drawn, job, state)
    # With the last block in place it just lets go.
    finished = ended & (to == phases.BACK) & (following.stage >= last)
    to = jnp.where(finished, phases.GO, to)
    over = ended & (to == phases.GO)
    step = jnp.abs(state.data.pose[0] - memory.pose)
    moving = idle | ended | (step[:2].max() > _STILL) | (step[2] > _STILL_TURN)
    return action, Memory(
        plan=drawn,
        job=jax.tree.map(lambda new, old: jnp.where(over, new, old), following, job),
        dock=jnp.where(over, 0.0, dock),
        phase=jnp.where(ended, to, phase).astype(jnp.int32),
        timer=jnp.where(ended, 0, timer + 1).astype(jnp.int32),
        pose=state.data.pose[0],
        stuck=jnp.where(moving, 0, memory.stuck + 1).astype(jnp.int32),
        begun=(memory.begun | ended) & ~(over & (following.stage != job.stage)),
        time=memory.time + 1,
    )


def _look(env: MatchRegions, memory: Memory, state: State) -> phases.View:
    pose, job = state.data.pose, memory.job
    robot, yaw = pose[0, :2], pose[0, 2]
    blocks = pose[-len(env.blocks) :, :2]
    away = blocks[job.block] - robot
    return phases.View(
        robot=robot, yaw=yaw, blocks=blocks, block=blocks[job.block],
        other=jnp.arange(len(env.blocks)) != job.block,
        distance=jnp.sqrt(jnp.sum(away**2) + 1e-12), ahead=phases.bearing(away, yaw),
        aside=away[0] * jnp.cos(yaw) + away[1] * jnp.sin(yaw),
        opening=(pose[1, 2] - pose[2, 2]) / 2,
        job=job, phase=memory.phase, timer=memory.timer, stuck=memory.stuck,
    )  # fmt: skip


def rollout(
    env: MatchRegions, key: PRNGKeyArray, failure: Int[Array, ""] | int = 0
) -> tuple[State, Int[Array, "T1"]]:
    """Plays one episode: states of T + 1 steps (the first is the reset), and the stage at each."""
    key_reset, key_plan = jax.random.split(key)
    state = env.reset(key_reset)
    memory = init(plan(env, key_plan, state, failure))

    def move(carry, _):
        state, memory = carry
        action, memory = act(env, memory, state)
        state = env.step(state, action)
        return (state, memory), (state, memory.job.stage)

    _, (states, stages) = jax.lax.scan(move, (state, memory), length=env.episode_length)
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), state, states)
    return states, jnp.concatenate([jnp.zeros(1, stages.dtype), stages])


def demonstrate(
    make: Callable[..., MatchRegions], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted, the brisker successes; a `gril_jax.envs.base.Demonstrate`.

    The gripper demonstrates, whichever robot will learn: the reward does not see the robot. `tell`
    hears how many episodes are good enough so far.

    Raises:
      ExpertError: the physics are MAGICAL's own, in which a command turns in full or not at all, or
        the expert fails so often that they cannot be collected.
    """
    env = make(robot="gripper", observation="rich", variant=wanted.places)
    if env.physics != "xmagical":
        raise ExpertError(
            "the scripted expert of match_regions needs physics=xmagical, but it is "
            f"{env.physics}: give videos with --demos"
        )
    env.episode_length = env.episode_length * 4 // 3  # the expert is slower than a policy
    played, failures = _SPARE * wanted.successes, wanted.failures
    batch = played + failures + wanted.successes // 3
    kinds = jnp.zeros(batch, jnp.int32)
    if failures:
        kinds = kinds.at[-failures:].set(1 + jnp.arange(failures) % (len(FAILURES) - 1))
    play = jax.jit(jax.vmap(lambda key, kind: rollout(env, key, kind)[0]))
    good: list[Episode] = []
    bad: list[Episode] = []
    for number in range(_ROUNDS):
        keys = jax.random.split(jax.random.fold_in(jax.random.key(wanted.seed), number), batch)
        states = jax.device_get(play(keys, kinds))
        for index in range(batch):
            done = states.metrics["success"][index]
            data = jax.tree.map(lambda x, i=index: x[i], states.data)
            if kinds[index] == 0 and done[-1] > 0:
                # Searched backwards: the first frame from which the task stays done.
                end = len(done) - int(np.argmin(done[::-1] > 0)) if not done.all() else 1
                data = jax.tree.map(lambda x, e=end: x[: e + _AFTER], data)
                good.append(Episode("success", "success", data))
            elif kinds[index] > 0 and done[-1] == 0:
                bad.append(Episode("failure", "failure", data))
        tell(min(len(good) // _SPARE, wanted.successes) + min(len(bad), failures))
        if len(good) >= played and len(bad) >= failures:
            slowest = sorted(len(e.data.pose) for e in good[:played])[wanted.successes - 1]
            brisk = [e for e in good[:played] if len(e.data.pose) <= slowest]
            episodes = brisk[: wanted.successes] + bad[:failures]
            return Demonstrations(env, env.object_names, episodes)
    raise ExpertError(
        f"the scripted expert succeeded in {len(good)} of {_ROUNDS * batch} episodes of the "
        f"{env.variant} layout, but demos.num and demos.num_validation ask for {wanted.successes}"
    )
