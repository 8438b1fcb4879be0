"""The compiled calls of policies' training, each of a few seconds, and a look at their numbers.

    calls = Calls(program, params, plan, configs, playing, wrong)
    held, made, found = calls.make(held, chunk, made)     # found: None until the chunk is complete

Shapes use S for the policies and U for the updates of a chunk.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int, Shaped

from gril_jax.config import RunConfig
from gril_jax.rl import training
from gril_jax.runs.pace import Pace

from . import diverged


class Held(NamedTuple):
    """The state of a training of S policies; saving it is enough to go on."""

    part: training.Part  # of the chunk that is being made, without an evaluation in progress
    bad: Int[np.ndarray, "S 2"]  # the first update that was not finite, from 1, and what; 0: none


def hold(part: training.Part, seeds: int) -> Held:
    """A training before its first call."""
    return Held(part._replace(playing=()), diverged.unknown(seeds))


class Calls:
    """Calls of one training; an evaluation in progress is kept here, and lost if the run ends.

    Args:
      program: what `policies.compiled_for` returns.
      params: the policy rewards' parameters (S, ...), on their devices.
      plan, configs: as for `policies.train`.
      playing: of the part before the first call.
      wrong: a sentence for each place of a seed that does not count.
    """

    def __init__(
        self, program: Any, params: Any, plan: Any, configs: Sequence[RunConfig], playing: Any,
        wrong: Mapping[int, str],
    ) -> None:  # fmt: skip
        self._advance, self._more = program.functions.advance, (program.hyper, params)
        self._plan, self._configs, self._wrong = plan, configs, wrong
        self._rounds = training.rounds(program.algorithm)
        # Of several in one update the first is said: losses tell more than what follows from them.
        rows = sorted(program.functions.shapes.rows, key=lambda x: (not x.startswith("loss"), x))
        self._names = [*rows, diverged.WEIGHT, diverged.UNDONE]
        self._playing, self._played, self._paces = playing, 0, (Pace(), Pace())

    def make(self, held: Held, chunk: int, made: int) -> tuple[Held, int, Any]:
        """One call of a chunk of which so many updates are made; see `loop.run_chunks`.

        Updates and rounds of an evaluation are never in one call. A chunk's (metrics, scores) come
        with its last one. Raises DivergedError if no seed is left that is finite.
        """
        count, began = self._plan.count(chunk), time.monotonic()
        until = count + self._rounds * self._plan.examines(chunk)
        first = made + self._played
        evaluating = first >= count
        pace = self._paces[evaluating]
        last = first + pace.moves((until if evaluating else count) - first)
        part = held.part._replace(playing=self._playing)
        numbers = map(jnp.int32, (first, last, count))
        part, (scores, finite) = self._advance(part, *self._more, *numbers)
        scores, finite, rows = jax.device_get((scores, finite, part.rows))
        pace.took(last - first, time.monotonic() - began)
        complete, updates = last == until, min(last, count)
        new, before = slice(made, updates), self._plan.done(chunk)
        bad = self._looked_at(held.bad, rows, finite, new, before)
        self._playing, self._played = part.playing, 0 if complete else last - updates
        held = Held(part._replace(playing=()), bad)
        return held, updates, (rows, scores) if complete else None

    def _looked_at(
        self,
        bad: Any,
        rows: Mapping[str, Shaped[np.ndarray, "S U"]],
        finite: Bool[np.ndarray, "S"],
        new: slice,
        before: int,
    ) -> Int[np.ndarray, "S 2"]:
        """The seeds that are not finite after the updates of a slice of a chunk, from what was
        known `before` the chunk."""
        if new.start == new.stop:
            return np.array(bad)
        metrics = {name: values[:, new] for name, values in rows.items()}
        undone = 2 * metrics["nonfinite"] > self._plan.steps
        weight = np.zeros(undone.shape)
        weight[~finite, -1] = np.nan  # seen after the last of them alone
        metrics |= {diverged.UNDONE: np.where(undone, np.nan, 0.0), diverged.WEIGHT: weight}
        bad = diverged.noted(bad, metrics, self._names, before + new.start)
        diverged.require_some(self.diverged(bad), len(bad))
        return bad

    def diverged(self, bad: Any) -> dict[int, str]:
        """A sentence for the place of each seed that does not count."""
        found, steps = diverged.faults(bad, self._names), self._plan.steps
        said = {n: diverged.of_policy(self._configs[n], one, steps) for n, one in found.items()}
        return said | {**self._wrong}
