"""Networks that read every object of an observation with the same weights.

A task may list its objects in its observation: some numbers of the robot, then a row of numbers for
each region, each block, and so on. `rows` says how many there are. An object that is not there has
zeros in its row. Neither the order of a kind's objects nor their number must matter.

So each row, beside the numbers of the robot, goes through the layers of its kind. It attends to the
other rows (two heads; Vaswani et al., NeurIPS 2017). Maxima and means over all rows summarise them
(Deep Sets; Zaheer et al., NeurIPS 2017), and plain layers follow. Observations are taken as they
are, of about unit size: statistics of each number by itself would tell the rows of a kind apart.

Shapes use B for any batch, O for the observation, N for rows of all kinds and H for their width.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from brax.training.agents.ppo.networks import PPONetworks
from brax.training.networks import FeedForwardNetwork
from flax import linen
from jaxtyping import Array, Bool, Float, PRNGKeyArray

Rows = tuple[tuple[int, int], ...]  # of each kind of object: how many rows, of how many numbers

_HEADS = 2
_NOWHERE = -1e9


def by_object(
    networks: PPONetworks, rows: Rows, size: int, before: int, hidden: Sequence[int], bits: bool
) -> PPONetworks:
    """The networks of PPO, made to read objects one by one.

    Args:
      networks: those that they replace, whose distribution of actions they keep.
      rows: the objects of the task's observation.
      size: O, the length of the policy's input: the task's own numbers, then with `bits` an
        activity bit of the robot and each row, then the reward's memory.
      before: numbers of the robot, which come first.
      hidden: widths of the layers that follow; a quarter of the first is H.
      bits: whether there are activity bits.
    """
    outputs = networks.parametric_action_distribution.param_size
    listing = dict(rows=rows, before=before, bits=bits, hidden=tuple(hidden))
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
    bits: bool
    hidden: tuple[int, ...]
    outputs: int

    @linen.compact
    def __call__(self, observation: Float[Array, "*B O"]) -> Float[Array, "*B outputs"]:
        robot, kinds = self._listed(observation)
        width = _HEADS * max(1, self.hidden[0] // (4 * _HEADS))
        each, there = [], []
        for rows in kinds:
            there.append((rows[..., :-1] != 0).any(axis=-1))  # but for the bit
            each.append(self._dense(width, rows) + self._dense(width, robot)[..., None, :])
        seen = linen.swish(jnp.concatenate(each, axis=-2))
        there = jnp.concatenate(there, axis=-1)
        seen = linen.swish(seen + self._asked(seen, there))
        out = jnp.concatenate([robot, *_summed_up(seen, there)], axis=-1)
        for width in self.hidden:
            out = linen.swish(self._dense(width, out))
        return self._dense(self.outputs, out)

    def _listed(self, observation: Array) -> tuple[Array, list[Array]]:
        """Numbers of the robot and of the memory (B, R), and the rows of each kind (B, n, F) with
        their activity bits, or zeros, at last."""
        at, kinds = self.before, []
        for count, numbers in self.rows:
            rows = observation[..., at : at + count * numbers]
            kinds.append(rows.reshape(*rows.shape[:-1], count, numbers))
            at += count * numbers
        total = sum(count for count, _ in self.rows)
        bits = observation[..., at + 1 : at + 1 + total]
        rest = observation[..., at + 1 + total :]
        if not self.bits:
            bits, rest = jnp.zeros((*observation.shape[:-1], total)), observation[..., at:]
        done = 0
        for i, (count, _) in enumerate(self.rows):
            bit = bits[..., done : done + count, None]
            kinds[i], done = jnp.concatenate([kinds[i], bit], axis=-1), done + count
        robot = jnp.concatenate([observation[..., : self.before], rest], axis=-1)
        return robot, [rows for rows in kinds if rows.shape[-2]]

    def _asked(self, seen: Float[Array, "*B N H"], there: Bool[Array, "*B N"]) -> Array:
        """Attention of each row to the rows that are there, (B, N, H)."""
        width = seen.shape[-1]
        parts = (*seen.shape[:-1], 3, _HEADS, width // _HEADS)
        asked = self._dense(3 * width, seen).reshape(parts)
        query, key, value = (asked[..., i, :, :] for i in range(3))
        score = jnp.einsum("...nhd,...mhd->...hnm", query, key) / (width // _HEADS) ** 0.5
        weight = jax.nn.softmax(jnp.where(there[..., None, None, :], score, _NOWHERE), axis=-1)
        found = jnp.einsum("...hnm,...mhd->...nhd", weight, value).reshape(seen.shape)
        return self._dense(width, found)

    def _dense(self, width: int, x: Array) -> Array:
        return linen.Dense(width, kernel_init=linen.initializers.lecun_uniform())(x)


def _summed_up(seen: Float[Array, "*B N H"], there: Bool[Array, "*B N"]) -> list[Array]:
    """Maximum and mean of the rows that are there, 0 if there are none; (B, H) each."""
    there = there[..., None]
    count = jnp.maximum(there.sum(axis=-2), 1)
    most = jnp.max(jnp.where(there, seen, _NOWHERE), axis=-2)
    mean = jnp.sum(jnp.where(there, seen, 0.0), axis=-2) / count
    return [jnp.where(there.any(axis=-2), most, 0.0), mean]
