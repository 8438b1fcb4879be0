"""Actions of MAGICAL's tasks, as commands to the robot; `match_regions.task` says what they are."""

import jax.numpy as jnp
import numpy as np
from gril_jax.envs.planar.joints import TURN_RATE, Command
from gril_jax.envs.planar.robots import FINGER_OPEN
from jaxtyping import Array, Float, Int

from .simulator import PRESETS

_MAX_SPEED = 0.8  # units/s
_OFFSET = 1.5  # rad: how far from the heading MAGICAL's turns aim
TURN_GAIN = {"original": 40.0, "smooth": TURN_RATE}  # rad/s for a turn of 1, before saturation


def command(action: Float[Array, "A"], *, gain: float, dt: float) -> Command:
    """x-magical's command for an action; `gain` is one of `TURN_GAIN`, `dt` the substep in s."""
    grip = action[2] if action.shape[0] > 2 else jnp.zeros(())
    speed = jnp.clip(action[0], -PRESETS["xmagical"].reverse, _MAX_SPEED)
    opening = jnp.clip(FINGER_OPEN - grip, 0.0, FINGER_OPEN)
    # A heading offset of a turns at a / (2 dt), because half of it is done when the servo acts.
    return Command(speed, 2 * dt * gain * action[1], opening)


def rounded_command(action: Float[Array, "A"]) -> Command:
    """MAGICAL's command nearest to an action: values past a half count, any grip above 0 closes."""
    grip = action[2] if action.shape[0] > 2 else jnp.zeros(())
    speed = jnp.where(action[0] > 0.5, _MAX_SPEED, 0.0)
    speed = jnp.where(action[0] < -0.5, -PRESETS["magical"].reverse, speed)
    turn = jnp.where(jnp.abs(action[1]) > 0.5, _OFFSET * jnp.sign(action[1]), 0.0)
    return Command(speed, turn, jnp.where(grip > 0, 0.0, FINGER_OPEN))


def from_magical(ids: Int[np.ndarray, "*T"]) -> Float[np.ndarray, "*T 3"]:
    """The actions with MAGICAL's numbers 9 * grip + 3 * turn + drive, from 0 to 17.

    drive: 0 none, 1 forward, 2 reverse. turn: 0 none, 1 left, 2 right. grip: 0 open, 1 close.

    >>> from_magical(np.array([0, 1, 12])).tolist()
    [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, 1.0]]
    """
    ids = np.asarray(ids)
    if ids.size and not (0 <= ids.min() and ids.max() < 18):
        raise ValueError(f"ids reach from {ids.min()} to {ids.max()}, but must lie in 0 to 17")
    way = np.array([0.0, 1.0, -1.0], np.float32)
    grip = np.array([-1.0, 1.0], np.float32)
    return np.stack([way[ids % 3], way[ids // 3 % 3], grip[ids // 9]], axis=-1)
