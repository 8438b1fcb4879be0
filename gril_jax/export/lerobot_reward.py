"""A learned reward with the method of lerobot's reward models: `compute_reward(batch)`.

    model = RewardModel(load_reward("reward.npz"))
    model.compute_reward({"center": center, "size": size})          # recordings: (B, T, N, 2)
    model.compute_reward({"center": ..., "size": ..., "active": ...})    # frames: (B, N, 2)

Shapes use B for samples, T for frames and N for objects. Values are NumPy arrays, JAX arrays or
torch tensors; neither torch nor lerobot is imported.
"""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.reward.learned_reward import LearnedReward

_SCENE = ("label", "is_robot", "present")  # (B, N) each, as for the reward of a state


class RewardModel:
    """The reward of each sample of a batch, for code that expects a lerobot reward model."""

    def __init__(self, learned: LearnedReward):
        self.learned = learned
        self._values = jax.jit(jax.vmap(self._value))

    def compute_reward(self, batch: Any) -> Float[np.ndarray, "B"]:
        """The reward of the last frame of each sample, float32: about -1 at the start and 0 at the
        goal.

        Args:
          batch: a mapping with `center` and `size`, box centres and sizes in the world units of
            the reward. Recordings from an episode's first frame on, (B, T, N, 2), tell which
            objects have moved; frames, (B, N, 2), need it as `active` (B, N). `label`, `is_robot`
            and `present` (B, N) are those of `learned.objects` if left out. Other keys are not
            read.

        Raises:
          ConfigError: a key is missing, a label is not one of the reward's classes, or boxes are
            in pixels.
          ShapeError: the arrays do not belong to the same samples.
        """
        names = ("center", "size", "active", *_SCENE)
        if not isinstance(batch, Mapping):
            raise ConfigError(
                f"batch is a {type(batch).__name__}, but must be a mapping of arrays."
            )
        given = {name: _array(name, batch[name]) for name in names if name in batch}
        self._check(given)
        return np.array(self._values(given), np.float32)

    def _value(self, given: dict[str, Any]) -> Any:
        center, size = given["center"], given["size"]
        scene = {name: given[name] for name in _SCENE if name in given}
        if center.ndim == 3:
            return self.learned.trajectory(center, size, **scene)[-1]
        return self.learned(center, size, given["active"], **scene)

    def _check(self, given: Mapping[str, Any]) -> None:
        """Refuses a wrong batch before it is compiled: compiled code does not see values."""
        recordings = "center" in given and given["center"].ndim == 4
        needed = ("center", "size") if recordings else ("center", "size", "active")
        if lacks := [name for name in needed if name not in given]:
            raise ConfigError(
                f"batch lacks {lacks[0]!r}; it must hold center and size of recordings "
                "(B, T, N, 2), or center, size and active of frames (B, N, 2)."
            )
        center, size = given["center"], given["size"]
        shape = center.shape
        if len(shape) not in (3, 4) or shape[-1] != 2:
            raise ShapeError(f"center has shape {shape}; it must be (B, N, 2) or (B, T, N, 2).")
        for name, value in given.items():
            per_object = shape[:1] + shape[-2:-1]
            expected = shape if name in ("center", "size") else per_object
            if value.shape != expected:
                raise ShapeError(
                    f"{name} has shape {value.shape} but center has shape {shape}; {name} must "
                    f"then be {expected}."
                )
        known = self.learned.objects
        if "label" not in given and known and len(known) != shape[-2]:
            raise ShapeError(
                f"center has {shape[-2]} objects, but the reward is for {len(known)}: "
                f"{', '.join(known)}; label (B, N) says which they are."
            )
        self.learned.init(center.reshape(-1, 2), size.reshape(-1, 2))  # refuses pixels
        labels, classes = given.get("label", jnp.zeros(0)), len(self.learned.classes)
        if jnp.any((labels < 0) | (labels >= classes)):
            raise ConfigError(f"label holds a number outside 0 to {classes - 1}, the classes.")


def _array(name: str, value: Any) -> jax.Array:
    """An array of a tensor of torch, wherever it is, or of anything else.

    Raises:
      ConfigError: it is not made of numbers.
    """
    try:
        found = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
    except ValueError:  # lists of different lengths
        found = np.array(None)
    if found.dtype.kind not in "biuf":
        raise ConfigError(f"{name} must be an array of numbers (see `compute_reward`).")
    return jnp.asarray(found)
