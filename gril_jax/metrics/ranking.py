"""Measures of how well one score ranks trajectories whose true order is known.

A score is one number of a trajectory, such as the reward of its last frame or its mean reward. A
rank is a whole number, higher for the better trajectory: failure 0, suboptimal 1, success 2.
Trajectories of equal rank are not compared, nor are those of different groups (tasks).

Everything here can be jitted. Shapes use B for trajectories. Both measures are NaN if no two
trajectories can be compared. `gril_jax.metrics.success_auc` is the measure for success and failure
alone: there policy ranking is twice the AUC less 1.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.types import checked


@checked
def policy_ranking(
    score: Float[Array, "B"], rank: Int[Array, "B"], group: Int[Array, "B"] | None = None
) -> Float[Array, ""]:
    """Kendall's tau-a of scores with ranks, as Robometer ranks policies (arXiv 2603.02115).

    One trajectory of each rank makes a tuple, whose tau-a is the share of pairs in order less the
    share of pairs in reverse. A tied pair counts in neither share. The result is the mean over all
    tuples of a group, then over groups: each rank counts the same, however many trajectories it
    has. It is in [-1, 1]; 1 if every better trajectory has the higher score, 0 by chance.

    >>> float(policy_ranking(jnp.array([0.1, 0.5, 0.9]), jnp.array([0, 1, 2])))
    1.0

    Args:
      score: of each trajectory, in any unit.
      rank: of each trajectory, higher is better.
      group: the task of each trajectory; all are of one if left out.
    """
    same = _same_group(score, group)
    pairs = same & (rank[:, None] > rank)
    alike = jnp.sum(same & (rank[:, None] == rank), axis=1).astype(score.dtype)
    # By linearity the mean over tuples is that over pairs of ranks, each a mean over its pairs.
    weight = jnp.where(pairs, 1.0 / (alike[:, None] * alike), 0.0)
    of_group = jnp.sum(jnp.where(same, jnp.sum(weight, axis=1), 0.0), axis=1)  # pairs of ranks
    weight = weight / jnp.where(of_group > 0, of_group, 1.0)[:, None]  # 1 in all for each group
    order = jnp.where(pairs, jnp.sign(score[:, None] - score), 0.0)
    return jnp.sum(weight * order) / jnp.sum(weight)


@checked
def preference_accuracy(
    score: Float[Array, "B"], rank: Int[Array, "B"], group: Int[Array, "B"] | None = None
) -> Float[Array, ""]:
    """Share of pairs of trajectories in which the better one has the higher score.

    A tie is a mistake; the AUC counts it half. All pairs of all groups count the same, in [0, 1].
    Robometer (arXiv 2603.02115) compares such pairs within a task.

    >>> float(preference_accuracy(jnp.array([0.1, 0.5, 0.5]), jnp.array([0, 1, 1])))
    1.0

    Args:
      score: of each trajectory, in any unit.
      rank: of each trajectory, higher is better.
      group: the task of each trajectory; all are of one if left out.
    """
    pairs = _same_group(score, group) & (rank[:, None] > rank)
    right = jnp.sum(pairs & (score[:, None] > score)).astype(score.dtype)
    return right / jnp.sum(pairs).astype(score.dtype)


def _same_group(score, group) -> Bool[Array, "B B"]:
    if group is None:
        return jnp.ones((len(score), len(score)), bool)
    return group[:, None] == group
