"""The plan of an expert of MatchRegions: blocks, their order and places, and how it fails.

A plan is sampled once an episode. From it, and from where things are by then, follows the next job:
one block and its place. K is the number of target blocks.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.base import State
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .task import MatchRegions

FAILURES = ("none", "stops_early", "wrong_block", "wrong_place", "drops")
_NEVER = 100_000  # control steps
_PAUSE = 2  # control steps: the longest wait before a stage
_APART = 0.33  # arena units between the centres of two blocks that do not touch


class Plan(NamedTuple):
    """The plan of one episode."""

    blocks: Int[Array, "K"]  # which block each stage brings
    slots: Float[Array, "K 2"]  # where to
    pauses: Int[Array, "K"]  # control steps to wait before each stage
    drop: Int[Array, ""]  # control steps after which the last stage lets go, on the way
    steps: Int[Array, ""]  # stand still from this control step on
    retry: Bool[Array, ""]  # fetch again what is not in the region, clear what should not be


class Job(NamedTuple):
    """One block to bring to one place."""

    stage: Int[Array, ""]  # of the plan; K when all is done
    block: Int[Array, ""]
    slot: Float[Array, "2"]


def plan(
    env: MatchRegions, key: PRNGKeyArray, state: State, failure: Int[Array, ""] | int = 0
) -> Plan:
    """Samples an order of targets, and their places; `failure` indexes `FAILURES`."""
    keys = jax.random.split(key, 10)
    k, count = env.num_targets, len(env.blocks)
    blocks, goal = state.data.pose[-count:, :2], state.data.regions[0]
    fails = {name: failure == i for i, name in enumerate(FAILURES)}
    order = jax.random.permutation(keys[0], k)
    away = goal[:2] - blocks[order]
    along = away / jnp.maximum(jnp.linalg.norm(away, axis=1, keepdims=True), 1e-6)
    # The first block goes deep into the region, so that the next finds room behind it.
    depth = jnp.linspace(0.12, -0.1, k) if k > 1 else jnp.zeros(1)
    noise = 0.04 * jax.random.normal(keys[1], (k, 2))
    reach = goal[2:] / 2 - 0.1
    slots = goal[:2] + jnp.clip(depth[:, None] * along + noise, -reach, reach)
    # The last block and its place are as the failure says.
    angle = jax.random.uniform(keys[2], (), maxval=2 * jnp.pi)
    aside = goal[:2] + 0.75 * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    aside = jnp.clip(aside, -0.75 * env.arena, 0.75 * env.arena)
    slots = slots.at[-1].set(jnp.where(fails["wrong_place"], aside, slots[-1]))
    other = jnp.minimum(jax.random.randint(keys[3], (), k, max(count, k + 1)), count - 1)
    order = order.at[-1].set(jnp.where(fails["wrong_block"], other, order[-1]))

    more = jax.random.split(keys[9], 3)
    return Plan(
        blocks=order,
        slots=slots,
        pauses=jax.random.randint(more[0], (k,), 0, _PAUSE + 1),
        drop=jnp.where(fails["drops"], jax.random.randint(more[1], (), 5, 10), _NEVER),
        steps=jnp.where(fails["stops_early"], jax.random.randint(more[2], (), 8, 40), _NEVER),
        retry=jnp.asarray(failure == 0),
    )


def next_job(env: MatchRegions, drawn: Plan, job: Job, state: State) -> Job:
    """The job after a job.

    A failing plan goes through its stages once. One that succeeds first clears out of the region
    what should not be there, then brings the first block that is missing.
    """
    last, goal = len(drawn.blocks), state.data.regions[0]
    blocks = state.data.pose[-len(env.blocks) :, :2]
    inside = (jnp.abs(blocks - goal[:2]) <= goal[2:] / 2 - 0.02).all(axis=1)
    missing = ~inside[drawn.blocks]
    again = jnp.where(missing.any(), jnp.argmax(missing), last)
    # A block meant for elsewhere that slipped away inside the region is fetched again even so.
    within = (jnp.abs(blocks[job.block] - goal[:2]) <= goal[2:] / 2).all()
    elsewhere = (jnp.abs(job.slot - goal[:2]) > goal[2:] / 2).any()
    onward = jnp.where(within & elsewhere, job.stage, jnp.minimum(job.stage + 1, last))
    stage = jnp.where(drawn.retry, again, onward).astype(jnp.int32)
    at = jnp.minimum(stage, last - 1)
    block = drawn.blocks[at]
    slot = jnp.where(drawn.retry, _free_slot(drawn.slots[at], block, blocks, goal), drawn.slots[at])

    stray = (jnp.abs(blocks - goal[:2]) <= goal[2:] / 2 + 0.02).all(axis=1)
    stray &= jnp.arange(len(env.blocks)) >= env.num_targets
    clear = drawn.retry & stray.any()
    which = jnp.argmax(stray).astype(block.dtype)
    # The plan's stage stays below K while something is to be cleared, or the expert would rest.
    return Job(
        stage=jnp.where(clear, at, stage),
        block=jnp.where(clear, which, block),
        slot=jnp.where(clear, _outside(which, blocks, goal, env.arena), slot),
    )


def _apart(points: Float[Array, "C 2"], which: Int[Array, ""], blocks: Float[Array, "B 2"]):
    """The lack of room at each point, summed over the other blocks."""
    gaps = jnp.sqrt(jnp.sum((points[:, None] - blocks) ** 2, axis=-1) + 1e-12)
    gaps = jnp.where(jnp.arange(len(blocks)) == which, 10.0, gaps)
    return jnp.maximum(_APART - gaps, 0.0).sum(axis=1)


def _free_slot(slot, which, blocks, goal) -> Float[Array, "2"]:
    """The free place in the region nearest to the planned one."""
    axis = jnp.linspace(-1.0, 1.0, 5)
    grid = jnp.stack(jnp.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    spots = jnp.concatenate([slot[None], goal[:2] + grid * (goal[2:] / 2 - 0.1)])
    far = jnp.sqrt(jnp.sum((spots - slot) ** 2, axis=1))
    # Nor should the way there sweep another block out.
    start = blocks[which]
    way = spots - start
    share = jnp.clip(
        (way @ (blocks - start).T) / jnp.maximum(jnp.sum(way**2, axis=1), 1e-6)[:, None], 0.0, 1.0
    )
    gap = jnp.sqrt(jnp.sum((start + share[..., None] * way[:, None] - blocks) ** 2, axis=-1) + 1e-9)
    inside = (jnp.abs(blocks - goal[:2]) <= goal[2:] / 2).all(axis=1)
    inside &= jnp.arange(len(blocks)) != which
    crossing = jnp.where(inside, jnp.maximum(_APART - gap, 0.0), 0.0).sum(axis=1)
    return spots[jnp.argmin(far + 10.0 * crossing + 20.0 * _apart(spots, which, blocks))]


def _outside(which, blocks, goal, arena) -> Float[Array, "2"]:
    """The nearest place outside the region that is clear of it, of walls and of other blocks."""
    axis = jnp.linspace(-arena + 0.25, arena - 0.25, 15)
    spots = jnp.stack(jnp.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    beyond = (jnp.abs(spots - goal[:2]) - goal[2:] / 2).max(axis=1)
    far = jnp.sqrt(jnp.sum((spots - blocks[which]) ** 2, axis=1))
    cost = far + 20.0 * _apart(spots, which, blocks) + 50.0 * jnp.maximum(0.12 - beyond, 0.0)
    return spots[jnp.argmin(cost)]
