"""The options of `gril subtasks`; JAX is not imported here."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from gril_jax.errors import ConfigError

__all__ = ["Options"]


@dataclass(frozen=True)
class Options:
    """The run, and how its stages are found; see `gril_jax.subtasks.agreement`."""

    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Folder of a run that has learned a reward."""
    out: str | None = None
    """New folder for the results; None for `subtasks` in the run's folder."""
    prominence: float = 0.125
    """Least height of a stage's rise; a learned reward goes from about -1 to 0."""
    smoothing: int = 15
    """Frames of the running median of the reward, odd."""
    patience: int | None = None
    """Frames without progress that end a stage; None finds it from the demonstrations."""
    support: float = 0.5
    """Least share of the demonstrations that must each show a stage's end."""
    sets: bool = False
    """Write each subtask's demonstrations as a separate set, films included."""

    def check(self) -> None:
        """Raises ConfigError if a value is out of its range."""
        rules = {
            "prominence": (self.prominence > 0, "above 0"),
            "smoothing": (self.smoothing >= 1 and self.smoothing % 2 == 1, "odd and at least 1"),
            "patience": (self.patience is None or self.patience >= 1, "at least 1"),
            "support": (0 < self.support <= 1, "above 0 and at most 1"),
        }
        for name, (holds, text) in rules.items():
            if not holds:
                raise ConfigError(f"--{name} is {getattr(self, name)}, but must be {text}")
