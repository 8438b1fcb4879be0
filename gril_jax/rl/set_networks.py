"""Networks that read every object of an observation with the same weights.

A task may list its objects in its observation: some numbers of the robot, then a row of numbers for
each region, each block, and so on. `rows` says how many there are. An object that is not there has
zeros in its row. Neither the order of a kind's objects nor their number must matter.

So each row, beside the numbers of the robot, goes through the layers of its kind. Each then learns
what all rows hold for it, by attention with one learned query for each number (Set Transformer; Lee
et al., ICML 2019), whose cost is linear in the rows. Maxima and means over all rows summarise them
(Deep Sets; Zaheer et al., NeurIPS 2017), and plain layers follow. Observations are taken as they
are, of about unit size: statistics of each number by itself would tell the rows of a kind apart.

With `half` products and what lies between layers are bfloat16; weights and outputs are float32.

Shapes use B for any batch, O for the observation, N for rows of all kinds and H for their width.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from brax.training.agents.ppo.networks import PPONetworks
from brax.training.networks import FeedForwardNetwork
from flax import linen
from jaxtyping import Array, Bool, Float, PRNGKeyArray

Rows = tuple[tuple[int, int], ...]  # of each kind of object: how many rows, of how many numbers

_NOWHERE = -1e9


def by_object(
    networks: PPONetworks,
    rows: Rows,
    size: int,
    before: int,
    hidden: Sequence[int],
    *,
    robot: int = 0,
    bits: bool,
    gradient: bool = False,
    half: bool = False,
) -> PPONetworks:
    """The networks of PPO, made to read objects one by one.

    Args:
      networks: those that they replace, whose distribution of actions they keep.
      rows: the objects of the task's observation.
      size: O, the length of the policy's input: the task's own numbers, then with `bits` an
        activity bit of the robot and each row, then with `gradient` two numbers of each, then the
        reward's memory.
      before: numbers of the robot, which come first.
      robot: which of the task's objects the robot is; the others are the rows.
      hidden: widths of the layers that follow; a quarter of the first is H.
      bits: whether there are activity bits.
      gradient: whether there are gradients of the reward (`gril_jax.rl.reward_gradient`).
      half: whether products are bfloat16, which a GPU multiplies faster.
    """
    outputs = networks.parametric_action_distribution.param_size
    more = (1,) * bits + (2,) * gradient
    listing = dict(
        rows=rows, before=before, robot=robot, more=more, half=half, hidden=tuple(hidden)
    )
    policy = _network(_Objects(outputs=outputs, **listing), size)
    value = _network(_Objects(outputs=1, **listing), size)

    def valued(normalizer: Any, params: Any, observation: Array) -> Array:
        return jnp.squeeze(value.apply(normalizer, params, observation), axis=-1)

    return PPONetworks(
        policy_network=policy,
        value_network=FeedForwardNetwork(value.init, valued),
        parametric_action_distribution=networks.parametric_action_distribution,
    )


def _network(module: linen.Module, size: int) -> FeedForwardNetwork:
    def init(key: PRNGKeyArray) -> Any:
        return module.init(key, jnp.zeros((1, size)))

    def apply(normalizer: Any, params: Any, observation: Array) -> Array:
        del normalizer
        return module.apply(params, observation)

    return FeedForwardNetwork(init, apply)


class _Objects(linen.Module):
    """`outputs` numbers from an observation."""

    rows: Rows
    before: int
    robot: int
    more: tuple[int, ...]  # numbers that the robot and each row have at the end, in parts
    half: bool
    hidden: tuple[int, ...]
    outputs: int

    @linen.compact
    def __call__(self, observation: Float[Array, "*B O"]) -> Float[Array, "*B outputs"]:
        robot, kinds = self._listed(observation)
        width = max(1, self.hidden[0] // 4)
        each, there = [], []
        for rows in kinds:
            own = rows.shape[-1] - sum(self.more)
            there.append((rows[..., :own] != 0).any(axis=-1))
            each.append(self._dense(width, rows) + self._dense(width, robot)[..., None, :])
        seen = linen.swish(jnp.concatenate(each, axis=-2))
        there = jnp.concatenate(there, axis=-1)
        seen = linen.swish(seen + self._asked(seen, there))
        out = jnp.concatenate([robot, *_summed_up(seen, there)], axis=-1)
        for width in self.hidden:
            out = linen.swish(self._dense(width, out))
        return self._dense(self.outputs, out.astype(jnp.float32), last=True)

    def _listed(self, observation: Array) -> tuple[Array, list[Array]]:
        """Numbers of the robot and of the memory (B, R), and the rows of each kind (B, n, F), whose
        last numbers are those of `more`."""
        at, kinds = self.before, []
        for count, numbers in self.rows:
            rows = observation[..., at : at + count * numbers]
            kinds.append(rows.reshape(*rows.shape[:-1], count, numbers))
            at += count * numbers
        total = sum(count for count, _ in self.rows)
        for numbers in self.more:
            end = at + (1 + total) * numbers
            each = observation[..., at:end].reshape(*observation.shape[:-1], 1 + total, numbers)
            each = jnp.delete(each, self.robot, axis=-2)  # the robot's count for nothing
            ends = [*itertools.accumulate(count for count, _ in self.rows)]
            each = jnp.split(each, ends[:-1], axis=-2)
            kinds = [jnp.concatenate(pair, axis=-1) for pair in zip(kinds, each, strict=True)]
            at = end
        robot = jnp.concatenate([observation[..., : self.before], observation[..., at:]], axis=-1)
        return robot, [rows for rows in kinds if rows.shape[-2]]

    def _asked(self, seen: Float[Array, "*B N H"], there: Bool[Array, "*B N"]) -> Array:
        """The answer of the rows that are there to the learned queries, (B, 1, H)."""
        width = seen.shape[-1]
        both = self._dense(2 * width, seen)
        score, value = both[..., :width].astype(jnp.float32), both[..., width:]
        weight = jax.nn.softmax(jnp.where(there[..., None], score, _NOWHERE), axis=-2)
        found = jnp.sum(weight.astype(value.dtype) * value, axis=-2, keepdims=True)
        return self._dense(width, found)

    def _dense(self, width: int, x: Array, *, last: bool = False) -> Array:
        products = jnp.bfloat16 if self.half and not last else None
        return linen.Dense(width, kernel_init=linen.initializers.lecun_uniform(), dtype=products)(x)


def _summed_up(seen: Float[Array, "*B N H"], there: Bool[Array, "*B N"]) -> list[Array]:
    """Maximum and mean of the rows that are there, 0 if there are none; (B, H) each."""
    there = there[..., None]
    count = jnp.maximum(there.sum(axis=-2), 1)
    most = jnp.max(jnp.where(there, seen, _NOWHERE), axis=-2)
    mean = jnp.sum(jnp.where(there, seen, 0.0), axis=-2) / count
    return [jnp.where(there.any(axis=-2), most, 0.0), mean]
