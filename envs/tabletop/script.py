"""Scripted episodes of a tabletop task: what a script is, and how one is played and judged.

Scripts play in C MuJoCo (`hand`): about 0.15 s an episode on a CPU. Grasps are of friction, so each
episode is judged by the task itself, from recorded positions, and a script only proposes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.checks import check_known

from .environment import Tabletop
from .hand import Hand
from .recorded import LIMIT, Run, cut, judge

AFTER = 10  # moments kept after success
EARLY = "stops early"  # the kind of failure that every script has: a success that breaks off


class Script(NamedTuple):
    """A task's scripted expert, and the ways in which it fails."""

    kinds: tuple[str, ...]
    """"success", then the failures in the order in which they are shown, `EARLY` among them."""
    follow: Callable[[Hand, np.random.Generator, str], None]
    """(hand, generator, kind): plays an episode; the generator is of its style, too."""
    shows: Callable[[Run], bool]
    """True if positions alone show that an episode without success is of its kind of failure."""

    def perform(
        self, env: Tabletop, start: State, rng: np.random.Generator, kind: str = "success"
    ) -> Hand:
        """The hand after an episode that nobody has judged yet; arguments, errors as for `play`."""
        check_known("kind", kind, self.kinds)
        hand = Hand(env, start, limit=LIMIT)
        self.follow(hand, rng, kind)
        hand.rest(AFTER)
        return hand

    def play(
        self, env: Tabletop, start: State, seed: int | tuple[int, ...], kind: str = "success"
    ) -> Run:
        """Plays one episode; that of a success ends half a second after it.

        `start` is of the task's `reset`; the seed is of the style and of what a failure leaves
        open. A script can miss its aim: check `as_meant`.

        Raises:
          ValueError: the kind is none of `kinds`.
        """
        rng = np.random.default_rng(seed)
        hand = self.perform(env, start, rng, kind)
        run = judge(env, start, kind, hand)
        length = len(run.qpos)
        if run.success.any():
            first = int(run.success.argmax())
            length = min(length, first + 1 + AFTER)
            if kind == EARLY:
                length = max(10, int(first * rng.uniform(0.15, 0.95)))
        return cut(run, length)

    def as_meant(self, run: Run) -> bool:
        """True if an episode succeeds, or fails, as its kind says."""
        if run.succeeded or run.kind == "success":
            return run.succeeded and run.kind == "success"
        return run.kind == EARLY or bool(self.shows(run))
