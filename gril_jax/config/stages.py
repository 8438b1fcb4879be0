"""How stages are found in a learned reward: the options of `gril subtasks`."""

from dataclasses import dataclass, field

from .command_line import RunFolder
from .rules import count, optional, rule


@dataclass(frozen=True)
class StageOptions:
    """The run, and how its stages are found; see `gril_jax.subtasks.agreement`."""

    run: RunFolder
    """Folder of a run that has learned a reward."""
    out: str | None = None
    """New folder for the results; None for `subtasks` in the run's folder."""
    prominence: float = field(default=0.125, metadata=rule(lambda x: x > 0, "above 0"))
    """Least height of a stage's rise; a learned reward goes from about -1 to 0."""
    smoothing: int = field(
        default=15, metadata=rule(lambda x: x >= 1 and x % 2 == 1, "odd and at least 1")
    )
    """Frames of the running median of the reward, odd."""
    patience: int | None = field(default=None, metadata=optional(count()))
    """Frames without progress that end a stage; None finds it from the demonstrations."""
    support: float = field(
        default=0.5, metadata=rule(lambda x: 0 < x <= 1, "above 0 and at most 1")
    )
    """Least share of the demonstrations that must each show a stage's end."""
    films: bool = False
    """Write each segment as a film of its own, `films/NAME-1.mp4` and so on."""
    lerobot: str | None = None
    """A LeRobot dataset from which the films were imported; a copy of it with the segments as
    subtask annotations goes to `lerobot` in the results."""
    sets: bool = False
    """Write each subtask's demonstrations as a separate set, films included."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""
