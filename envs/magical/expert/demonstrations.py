"""Demonstrations of MAGICAL's tasks: of a scripted expert's episodes, the brisker successes."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Demonstrations, Episode, ExpertError, Wanted
from jaxtyping import Array, Int, PRNGKeyArray

_SPARE = 2  # successes played for each that is kept: the brisker half, as a person would choose
_ROUNDS = 8  # batches of episodes before giving up on an expert that fails
_AFTER = 12  # frames that a video goes on once the task is done

Rollout = Callable[[PRNGKeyArray, Int[Array, ""]], Any]


def record(
    env: Any, rollout: Rollout, num_kinds: int, wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted of a task with `blocks` and a `variant`.

    `rollout` is (key, kind) -> states (T, ...) of an episode: a success for kind 0, else a failure.
    `tell` hears how many episodes are good enough so far.

    Raises:
      ExpertError: the expert fails so often that they cannot be collected.
    """
    played, failures = _SPARE * wanted.successes, wanted.failures
    batch = played + failures + wanted.successes // 3
    kinds = jnp.zeros(batch, jnp.int32)
    if failures:
        kinds = kinds.at[-failures:].set(1 + jnp.arange(failures) % (num_kinds - 1))
    play = jax.jit(jax.vmap(rollout))
    good: list[Episode] = []
    bad: list[Episode] = []
    for number in range(_ROUNDS):
        keys = jax.random.split(jax.random.fold_in(jax.random.key(wanted.seed), number), batch)
        states = jax.device_get(play(keys, kinds))
        for index in range(batch):
            done = states.metrics["success"][index]
            data = jax.tree.map(lambda x, i=index: x[i], states.data)
            if kinds[index] == 0 and done[-1] > 0:
                # From the end backwards: the moment after which it stays done.
                end = len(done) - int(np.argmin(done[::-1] > 0)) if not done.all() else 1
                data = jax.tree.map(lambda x, e=end: x[: e + _AFTER], data)
                good.append(Episode("success", "success", data))
            elif kinds[index] > 0 and done[-1] == 0:
                bad.append(Episode("failure", "failure", data))
        tell(min(len(good) // _SPARE, wanted.successes) + min(len(bad), failures))
        if len(good) >= played and len(bad) >= failures:
            slowest = sorted(len(e.data.pose) for e in good[:played])[wanted.successes - 1]
            brisk = [e for e in good[:played] if len(e.data.pose) <= slowest]
            episodes = brisk[: wanted.successes] + bad[:failures]
            return Demonstrations(env, ("goal", "robot", *env.blocks), episodes)
    raise ExpertError(
        f"the scripted expert solved {len(good)} of {_ROUNDS * batch} episodes of the "
        f"{env.variant} layout, but demos.num and demos.num_validation ask for {wanted.successes}"
    )
