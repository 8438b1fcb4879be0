"""Potential-based shaping (Ng, Harada and Russell, ICML 1999): F = discount * phi(s') - phi(s).

    phi = reward.latent_goal_reward(params, graph, config)          # of s, then of s'
    r = task_reward + shaping.step(phi, next_phi, terminated, discount=0.99)

A reward added in this form changes no optimal policy, whatever the potential phi is: along an
episode the terms cancel but for its two ends. The learned reward is such a potential, from -1 at
the start to 0 at the goal. Added as a potential it guides, but a policy gains nothing by staying in
a place that merely looks good. The optimum is that of the reward that it is added to, and a sparse
one will do.

How episodes end matters. A terminated one has nothing after it, so its last potential counts as
0. Else an episode would gain by ending in a state of high potential (Grzes, AAMAS 2017). After a
time limit the values go on, so phi stays: that of the last state reached, not of the next episode's
first. A potential may depend on what an episode remembers, such as activity bits, as long as each
is taken at its own time (Devlin and Kudenko, AAMAS 2012).

Shapes use S for the states of an episode, one more than its control steps; leading axes are a
batch.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.errors import ConfigError, ShapeError


def step(
    potential: Float[Array, "*batch"],
    next_potential: Float[Array, "*batch"],
    terminated: Bool[Array, "*batch"] | Float[Array, "*batch"] | None = None,
    *,
    discount: Float[Array, ""] | float,
    zero_at_end: bool = True,
) -> Float[Array, "*batch"]:
    """Shaping term of a control step from s to s', to be added to its reward.

    >>> round(float(step(jnp.array(-1.0), jnp.array(-0.5), discount=0.9)), 3)
    0.55

    Args:
      potential: phi(s), of the state that the action was taken in.
      next_potential: phi(s'), of the state that it led to: before an automatic reset.
      terminated: the task ended in s', so that nothing comes after it; True, or above 0. Not for
        time limits. None if it never ends.
      discount: the learner's, from 0 to 1; with another one policies are no longer kept.
      zero_at_end: phi(s') counts as 0 where the task ended, whatever it is, NaN included. If not,
        it counts as it is: right only where phi is 0 in every state that the task can end in.

    Returns:
      One value for each, of the potential's units.

    Raises:
      ShapeError: the arrays differ in shape.
      ConfigError: the discount is known and not from 0 to 1.
    """
    arrays = {"potential": potential, "next_potential": next_potential}
    _check(arrays | ({} if terminated is None else {"terminated": terminated}), discount)
    if terminated is not None and zero_at_end:
        next_potential = jnp.where(terminated > 0, 0.0, next_potential)
    return discount * next_potential - potential


def _check(arrays, discount):
    if len({x.shape for x in arrays.values()}) > 1:
        shapes = " and ".join(f"{name} has shape {x.shape}" for name, x in arrays.items())
        raise ShapeError(f"{shapes}; they must be of one shape.")
    if not isinstance(discount, jax.core.Tracer) and not 0 <= float(discount) <= 1:
        raise ConfigError(f"discount is {discount}; it must be from 0 to 1.")
