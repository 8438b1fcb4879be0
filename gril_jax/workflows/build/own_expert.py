"""Demonstrations by the scripted expert of a user's own task: `expert(state, key) -> action`.

Boxes are the task's own, and frames are its drawing. An episode ends a few frames after its
success; what ends without one is a failure.
"""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

from gril_jax.envs.base import Demonstrations, Env, Episode, ExpertError, Film, Wanted
from gril_jax.envs.user_tasks import protocol

from . import filming

_AFTER = 5  # frames that a film goes on once the task is done
_ROUNDS = 4  # times as many episodes are played as are wanted, before giving up


def demonstrate(
    make: Callable[..., Env], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """Plays the expert until there are enough successes; failures are those that came along."""
    env = make()
    if env.expert is None:
        raise ExpertError("the task has no `expert`, a function (state, key) -> action")
    episodes, good, bad = jax.jit(protocol.play(env, env.expert)), [], []
    key, each = jax.random.key(wanted.seed), wanted.successes + wanted.failures
    for turn in range(_ROUNDS):
        states = jax.device_get(episodes(jax.random.split(jax.random.fold_in(key, turn), each)))
        if (wrong := protocol.not_finite(states)) is not None:
            raise ExpertError(f"the expert's episodes have NaN or infinity in {wrong}")
        for number in range(each):
            one = jax.tree.map(lambda x, n=number: x[:, n], states)
            ended = _end(one)
            (bad if ended is None else good).append(_cut(one, ended))
        tell(min(len(good), wanted.successes) + min(len(bad), wanted.failures))
        if len(good) >= wanted.successes:
            break
    else:
        raise ExpertError(
            f"the expert ended {len(good)} of {_ROUNDS * each} episodes with success, but "
            f"{wanted.successes} are wanted"
        )
    shown = good[: wanted.successes] + bad[: wanted.failures]
    kinds = ["success"] * wanted.successes + ["failure"] * (len(shown) - wanted.successes)
    objects = jax.tree.map(lambda x: x[0], shown[0].objects)
    names = tuple(env.classes[i] for i in objects.label)
    robots = tuple(sorted({names[i] for i in np.flatnonzero(objects.is_robot)}))
    played = [Episode(kind, kind, one.data) for kind, one in zip(kinds, shown, strict=True)]
    return Demonstrations(env, names, played, _films(env, shown), robots)


def _end(states: Any) -> int | None:
    """The first frame from which the task stays done; None if it is not done at the end."""
    done = states.metrics["success"] > 0.5
    if (ended := states.done[1:] > 0.5).any():  # what follows belongs to no episode
        done = done[: int(np.argmax(ended)) + 2]
    if not done[-1] or done[0]:
        return None
    return len(done) - int(np.argmin(done[::-1]))


def _cut(states: Any, end: int | None) -> Any:
    """The frames of an episode that are shown."""
    last = len(states.done) if end is None else min(end + 1 + _AFTER, len(states.done))
    ended = np.flatnonzero(states.done > 0.5)
    last = min([last, *(ended[:1] + 1)])
    return jax.tree.map(lambda x: x[:last], states)


def _films(env: Env, episodes: list[Any]) -> Iterator[Film]:
    for states in episodes:
        seen = states.objects
        shown = np.ones(seen.center.shape[:2], bool)
        yield Film(filming.outlines(env, states.data), seen.center, seen.size, shown)
