"""What the registry needs of a tabletop task: its constructor and its demonstrations."""

import functools
from collections.abc import Callable

from gril_jax.envs.base import Demonstrations, Wanted

from .demonstrations import JITTER, record
from .environment import Tabletop
from .recorded import moments
from .script import Script
from .start import Moments
from .task import Task


class Entry:
    """A task and its scripted expert; what is compiled for one environment serves as long as it.

    `moments()` are those within the expert's episodes, at which training may begin.
    """

    def __init__(self, task: Task, script: Script):
        self.task, self.script = task, script
        self.moments = functools.cache(self._recorded)
        self._demonstrated = functools.lru_cache(maxsize=1)(self.make)

    def make(self, *, varied_starts: float = 0.0, **options) -> Tabletop:
        """The environment; other `options` are those of `Tabletop`.

        `varied_starts` is the share of the episodes that begin within one of a scripted expert,
        which is played first (10 s on 2 CPU cores).
        """
        found = self.moments() if varied_starts else None
        return Tabletop(self.task, varied_starts=varied_starts, moments=found, **options)

    def _recorded(self) -> Moments:
        """Moments of the expert, recorded once a process: no option of an episode changes them."""
        return moments(Tabletop(self.task), self.script.perform)

    def demonstrate(
        self, make: Callable[..., Tabletop], wanted: Wanted, tell: Callable[[int], None]
    ) -> Demonstrations:
        """The demonstrations wanted; a `gril_jax.envs.base.Demonstrate`.

        The expert plays with the task's own settings: whatever options a policy has, the
        demonstrations stay the same.
        """
        del make
        env = self._demonstrated(jitter=JITTER[wanted.places])
        return record(env, self.script, wanted, tell)
