"""Three ways to get the rewards of stages from their segments.

    landings   one encoder of whole films and its one reward; a stage pays no less than what
               demonstrations are paid at its beginning (`gril_jax.reward.staircase`)
    goals      the same encoder; each stage has a goal of its own, the mean latent of its segments'
               ends, as in `gril_jax.reward.chain`
    fresh      an encoder for each stage, trained on the stage's segments alone, as films that begin
               there: also activity (Eq. 4) begins anew

Architecture, loss and key are the same for all encoders.
"""

import dataclasses
import math
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from gril_jax import reward
from gril_jax.encoders.encoder import Params
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.options import Hyper, Static
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.types import DemoBatch

from .segments import Part

_NO_FLOOR = -1e6


class StageReward(NamedTuple):
    """The reward of one stage."""

    learned: RewardParams  # minus the distance to its goal (Eq. 7)
    floor: Float[Array, ""]  # what is paid at least


class Way(NamedTuple):
    """The rewards of all stages, and what they cost."""

    stages: list[StageReward]
    restarts: bool  # activity begins anew with each stage
    steps: int  # gradient steps of all encoders
    seconds: float  # of these steps, without compiling


class Trained(NamedTuple):
    """An encoder, and what it cost."""

    encoder: Params
    steps: int
    seconds: float


def trained(
    key: PRNGKeyArray, films: DemoBatch, hyper: Hyper, static: Static, steps: int
) -> Trained:
    """An encoder after so many gradient steps on the films.

    The key, which is consumed, is that of `gril pretrain` if it is of `run.seed` folded with 0.
    """
    static = dataclasses.replace(static, updates=math.gcd(steps, static.updates))
    state = pretrain.init(key, films, static)
    program = pretrain.step.lower(state, films, hyper, static, None).compile()
    begun = time.perf_counter()
    for _ in range(steps // static.updates):
        state, _ = program(state, films, hyper, static, None)
    jax.block_until_ready(state.num_updates)
    return Trained(state.params.encoder, steps, time.perf_counter() - begun)


def landings(shared: Trained, learned: RewardParams, level: Float[Array, "K"]) -> Way:
    """One reward, with the floors that its levels at the ends of stages are."""
    floors = jnp.concatenate([jnp.full(1, _NO_FLOOR), level[:-1]])
    return Way([StageReward(learned, floor) for floor in floors], False, *shared[1:])


def goals(shared: Trained, parts: list[Part], hyper: Hyper, static: Static) -> Way:
    """One encoder, with a goal and a scale for each stage's segments."""
    return Way(
        [_of_goal(shared, part, hyper, static, part.bits) for part in parts], False, *shared[1:]
    )


def fresh(
    key: PRNGKeyArray, parts: list[Part], hyper: Hyper, static: Static, steps: int, *, share: bool
) -> Way:
    """An encoder for each stage, of so many steps; with `share`, of so many in all.

    What is due by a number of steps (learning rate, time agreement) then goes as much faster.
    """
    if share:
        steps = max(1, steps // len(parts))
        hyper = hyper._replace(
            decay_updates=hyper.decay_updates / len(parts), warmup=hyper.warmup / len(parts)
        )
    each = [trained(key, part.films, hyper, static, steps) for part in parts]
    pairs = zip(each, parts, strict=True)
    return Way(
        [_of_goal(one, part, hyper, static, own_bits(part, hyper, static)) for one, part in pairs],
        True,
        sum(one.steps for one in each),
        sum(one.seconds for one in each),
    )


def own_bits(part: Part, hyper: Hyper, static: Static) -> Bool[Array, "B T N"]:
    """The activity of segments whose beginning is that of an episode."""
    return pretrain.activity_bits(part.films, hyper, static)


def _of_goal(one: Trained, part: Part, hyper: Hyper, static: Static, bits) -> StageReward:
    learned = reward.from_demos(
        one.encoder, part.films, static.encoder, alpha=hyper.alpha, active=bits
    )
    return StageReward(learned, jnp.full((), _NO_FLOOR))
