"""Parts of a policy: its parameters, normalisation of observations, and networks of sub-policies.

With sub-policies each stage of a task has weights of its own. The learned reward infers an
episode's stage from the latents alone (`gril_jax.reward.staircase`). The policy sees it: the last
number of its observation is the share of the stages that are finished. The network of the present
stage answers, for actions and for values. So a sub-policy begins where its predecessor has finished
its stage, learns from its own stage alone, and still explores when the ones before it have settled.

At hand-over, a stage bootstraps from its successor's value estimate, so that it learns to end where
the successor can go on. T-STAR (Lee et al., CoRL 2021) trains sub-policies one by one, then keeps
them together by a loss on where a stage ends. Here all learn at once, in one compiled step.
"""

import itertools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from brax.training.acme import running_statistics, specs
from brax.training.networks import FeedForwardNetwork
from jaxtyping import Array, Float, Int, PRNGKeyArray

# Tasks give observations of about unit size. An input that hardly varies in training, such as the
# place of a region that always lies there, has next to no deviation: divided by it, a change that
# nobody would notice is beyond all that the networks have seen. Policies of MatchRegions whose
# inputs were divided by 1e-6 succeeded in none of the Jitter starts; with this they do in most. A
# task whose observations are far smaller than that should scale them.
LEAST_DEVIATION = 0.1
_ROUNDING = 1e-4  # of a share in float32
MAX_OBSERVATION = 10.0  # in standard deviations: no single input outweighs all others


class Policy(NamedTuple):
    """Parameters needed to act: observation statistics and the policy network's weights."""

    normalizer: running_statistics.RunningStatisticsState
    params: Any


def fresh_normalizer(observation_size: int) -> running_statistics.RunningStatisticsState:
    """Statistics before any observation: mean 0 and deviation 1."""
    return running_statistics.init_state(specs.Array((observation_size,), jnp.dtype("float32")))


def fresh_weights(key: PRNGKeyArray, *networks: Any) -> list[Any]:
    """Weights distributed as by brax's own `init`, but sampled for all layers at once.

    Kernels are uniform in +-sqrt(3 / inputs), the default of brax (LeCun et al. 1998), and biases
    are 0. The key is consumed.
    """
    every = [jax.eval_shape(network.init, key) for network in networks]
    named, tree = jax.tree.flatten_with_path(every)
    shapes = [shape for _, shape in named]
    biases = [path[-1].key == "bias" for path, _ in named]
    sizes = (0 if bias else math.prod(x.shape) for bias, x in zip(biases, shapes, strict=True))
    ends = list(itertools.accumulate(sizes))
    unit = jax.random.uniform(key, (ends[-1],), minval=-1.0)

    def weights(shape, end, bias):
        if bias:
            return jnp.zeros(shape.shape, shape.dtype)
        drawn = unit[end - math.prod(shape.shape) : end].reshape(shape.shape)
        return (math.sqrt(3 / shape.shape[-2]) * drawn).astype(shape.dtype)

    return jax.tree.unflatten(tree, map(weights, shapes, ends, biases))


def observed(
    statistics: running_statistics.RunningStatisticsState, observation: Float[Array, "*batch O"]
) -> running_statistics.RunningStatisticsState:
    """Statistics updated with more observations; no deviation is below `LEAST_DEVIATION`."""
    return running_statistics.update(statistics, observation, std_min_value=LEAST_DEVIATION)


def normalize(
    observation: Float[Array, "*batch O"], statistics: running_statistics.RunningStatisticsState
) -> Float[Array, "*batch O"]:
    """Observations as standard deviations from their mean, clipped at `MAX_OBSERVATION` of them."""
    return running_statistics.normalize(observation, statistics, max_abs_value=MAX_OBSERVATION)


def of_stages(network: FeedForwardNetwork, count: int) -> FeedForwardNetwork:
    """A network with weights for each of so many stages, leaves (count, ...); `network` if it is
    one.

    Its `apply` takes the network's arguments, statistics of observations, weights and observations
    (..., O), and answers as the network of each observation's stage does.
    """
    if count == 1:
        return network

    def init(key: PRNGKeyArray) -> Any:
        return jax.vmap(network.init)(jax.random.split(key, count))

    def apply(normalizer: Any, params: Any, observation: Float[Array, "*batch O"]) -> Array:
        each = jax.vmap(network.apply, (None, 0, None))(normalizer, params, observation)
        chosen = jax.nn.one_hot(stage(observation, count), count, axis=0, dtype=bool)
        chosen = chosen.reshape(*chosen.shape, *(1,) * (each.ndim - chosen.ndim))
        return jnp.sum(jnp.where(chosen, each, 0), axis=0)

    return FeedForwardNetwork(init, apply)


def stage(observation: Float[Array, "*batch O"], count: int) -> Int[Array, "*batch"]:
    """The sub-policy that acts, from 0; the last goes on when all stages are finished.

    Stages are shared out evenly: with as many stages as sub-policies each has one."""
    begun = jnp.floor(observation[..., -1] * count + _ROUNDING).astype(jnp.int32)
    return jnp.clip(begun, 0, count - 1)
