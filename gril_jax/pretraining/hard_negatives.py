"""Hard negatives: the states of a policy's episodes that a reward overestimates most.

A policy that is trained on a learned reward visits states that no demonstration has. The last
frames of the demonstrations give a target reward for each of them, minus its
`gril_jax.pretraining.final_places.misplacement`. The reward overestimates a state if it is higher
than the target. The next reward should learn from such states (`gril_jax.pretraining.contrast`).

As in VICE (Fu et al., NeurIPS 2018) a policy's own states are the negatives, but each has a target
distance from the goal instead of a class. Object boxes suffice: no reward of the task, no success,
no action.

Shapes use E for episodes, T for their frames, N for objects and K for what is chosen.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.audit.scene_reward import Scene
from gril_jax.graphs.scene import safe_norm

from .batch import Ends
from .contrast import cost


class Chosen(NamedTuple):
    """Chosen states of episodes, the most overestimated first."""

    scenes: Scene  # leaves (K, N, ...)
    excess: Float[Array, "K"]  # reward above its target; 0 where no state was left to choose
    known: Bool[Array, "K"]  # False there


def due_rewards(places: Ends, scenes: Scene, **costs: Any) -> Float[Array, "*S"]:
    """Minus the cost of what each scene lacks: at most 0; options as in `misplacement`."""

    def one(scene):
        return -cost(places, scene, ~scene.is_robot, **costs)

    for _ in scenes.active.shape[:-1]:
        one = jax.vmap(one)
    return one(scenes)


@functools.partial(jax.jit, static_argnames=("num", "every"))
def choose(
    scenes: Scene,
    paid: Float[Array, "E T"],
    due: Float[Array, "E T"],
    *,
    num: int,
    every: int = 5,
    apart: Float[Array, ""] | float = 0.1,
    ended: Float[Array, ""] | float = 0.1,
    least: Float[Array, ""] | float = 0.1,
) -> Chosen:
    """The states that the reward overestimates most, from episodes without success at the end.

    One after the other: the most overestimated of those that are left, without its neighbours in
    time and without its likes in other episodes, so that the chosen ones differ.

    Args:
      scenes: leaves (E, T, N, ...).
      paid: the learned reward of each, at least about -1 and at most 0 on the demonstrations.
      due: its target, see `due_rewards`.
      num: K, how many are chosen at most.
      every: of an episode, at most one in as many frames to either side.
      apart: states are alike if all objects are closer than this to where they are in the other,
        in diagonals of their boxes, and the activity bits are equal.
      ended: an episode whose last frame lacks no more than this ends as demonstrations do: nothing
        of it is chosen.
      least: nor is anything that is overestimated by no more than this.

    Returns:
      K states, of which the first ones are known; states that are not finite are never chosen.
    """
    excess = jnp.asarray(paid - due)
    failed = due[:, -1:] < -ended
    left = jnp.where(failed & (excess > least) & jnp.isfinite(excess), excess, -jnp.inf)
    frames = jnp.arange(left.shape[1])

    def pick(left, _):
        episode, frame = jnp.unravel_index(jnp.argmax(left), left.shape)
        most = left[episode, frame]
        chosen = jax.tree.map(lambda x: x[episode, frame], scenes)
        close = (jnp.arange(left.shape[0]) == episode)[:, None] & (jnp.abs(frames - frame) < every)
        left = jnp.where(close | _alike(scenes, chosen, apart), -jnp.inf, left)
        return left, (chosen, most)

    _, (chosen, most) = jax.lax.scan(pick, left, length=num)
    known = jnp.isfinite(most)
    return Chosen(chosen, jnp.where(known, most, 0.0), known)


def _alike(scenes: Scene, one: Scene, apart) -> Bool[Array, "E T"]:
    """True for scenes that show the same as one of them."""
    near = safe_norm(scenes.center - one.center) < apart * safe_norm(one.size)
    return (near & (scenes.active == one.active) & (scenes.label == one.label)).all(axis=-1)
