"""What is refused among the options of a task on the table."""

from gril_jax.envs.panda import control

from . import physics
from . import reward as tabletop_reward

__all__ = ["check_counts", "check_names", "check_shares"]

_KNOWN = {
    "controller": control.CONTROLLERS,
    "reward": tabletop_reward.REWARDS,
    "impl": physics.IMPLEMENTATIONS,
}


def check_names(**names: str) -> None:
    """Raises a ValueError for one that is not known."""
    for what, value in names.items():
        if value not in _KNOWN[what]:
            known = ", ".join(_KNOWN[what])
            raise ValueError(f"{what} is {value!r}, but must be one of {known}")


def check_shares(**shares: float) -> None:
    """The same for one that is not between 0 and 1."""
    for what, share in shares.items():
        if not 0 <= share <= 1:
            raise ValueError(f"{what} is {share}, but must be between 0 and 1")


def check_counts(**counts: int) -> None:
    """The same for one below 1."""
    for what, count in counts.items():
        if count < 1:
            raise ValueError(f"{what} is {count}, but must be at least 1")
