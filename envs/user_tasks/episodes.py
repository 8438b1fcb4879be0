"""Findings about a task of one's own that only episodes show, each a sentence."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import State

from .completed import Completed
from .files import FAILURES, TaskError, fault
from .protocol import not_finite

_EPISODES = 16
_AT_SUCCESS = (
    "episodes end at success, after which a step of a learned reward of 0 and more is lost: "
    "--run.reward-offset 0 makes it 0 and less, or let done stay 0 there"
)
_SLACK = 1.05  # of the picture, in which a box's centre may lie


class Finding(NamedTuple):
    """One point of the contract."""

    name: str
    holds: bool
    said: str  # a sentence
    needed: bool = True  # nothing works without it


def _judged(name: str, holds: Any, yes: str, no: str, *, needed: bool = True) -> Finding:
    return Finding(name, bool(holds), yes if holds else no, needed)


def findings(env: Completed) -> Iterator[Finding]:
    """Every point that needs episodes, in turn; `env` has passed `protocol.completed`."""
    keys = jax.random.split(jax.random.key(0), _EPISODES)
    first = jax.jit(jax.vmap(env.reset))(keys)
    yield _pure(env, keys, first)
    yield _vmapped(env, first)
    states = jax.device_get(jax.jit(lambda: _played(env, keys))())
    bad, random = not_finite(states), f"{_EPISODES} episodes of random actions"
    yield _judged(
        "finite", bad is None, f"all numbers stay finite in {random}",
        f"{bad} becomes NaN or infinite in {random}",
    )  # fmt: skip
    yield _judged(
        "sizes", (states.objects.size > 0).all(), "boxes keep a width and a height",
        f"objects.size gets to 0 or below in {random}",
    )  # fmt: skip
    yield _in_picture(env, states)
    yield from _ends(env, first, states)
    label, robot = states.objects.label, states.objects.is_robot
    yield _judged(
        "labels stay", (label == label[:1]).all() and (robot == robot[:1]).all(),
        "label and is_robot stay the same in an episode",
        "label or is_robot changes in an episode, but says what an object is",
    )  # fmt: skip
    checks = {"stages": lambda: _stages(env, states), "place": lambda: _placed(env, first),
              "expert": lambda: _expert(env, keys)}  # fmt: skip
    checks["drawing"] = lambda: _drawing(env, states)
    for name, check in checks.items():
        if name == "drawing" or getattr(env, name) is not None:
            yield _or_failed(name, check, env)


def _or_failed(name: str, check: Callable[[], Finding], env: Completed) -> Finding:
    """The finding of a check; that of a failure if the user's code fails in it."""
    try:
        return check()
    except TaskError as error:
        return Finding(name, False, str(error))
    except FAILURES as error:
        return Finding(name, False, f"{env.file}: {name} fails ({fault(error, env.file)})")


def _random(env: Completed, key: Any) -> Any:
    return jax.random.uniform(key, (_EPISODES, env.action_size), minval=-1.0)


def _played(env: Completed, keys: Any) -> State:
    """Whole episodes of random actions, leaves (T + 1, E, ...)."""
    steps = jax.random.split(jax.random.key(1), env.episode_length)
    move = lambda states, key: jax.vmap(env.step)(states, _random(env, key))  # noqa: E731
    return _rolled(move, jax.vmap(env.reset)(keys), steps)


def _rolled(move: Callable[[State, Any], State], first: State, keys: Any) -> State:
    """All states from the first on, one move for each key: leaves (T + 1, E, ...). An episode stays
    where the task has ended it."""

    def kept(over, old, new):
        return jax.tree.map(lambda a, b: jnp.where(over, a, b), old, new)

    def step(states, key):
        states = jax.vmap(kept)(states.done > 0.5, states, move(states, key))
        return states, states

    _, after = jax.lax.scan(step, first, keys)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, after)


def _same(a: Any, b: Any) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    numbers = [(x, y) for x, y in pairs if not jnp.issubdtype(x.dtype, jax.dtypes.prng_key)]
    return all(np.allclose(x, y, rtol=1e-4, atol=1e-5, equal_nan=True) for x, y in numbers)


def _pure(env: Completed, keys: Any, first: State) -> Finding:
    again, one = jax.jit(jax.vmap(env.reset))(keys), jax.tree.map(lambda x: x[0], first)
    return _judged(
        "pure", _same(first, again) and _same(one, env.reset(keys[0])),
        "the same key gives the same start, compiled or not",
        "the same key gives different starts: reset may use its key alone, and keep nothing",
    )  # fmt: skip


def _vmapped(env: Completed, first: State) -> Finding:
    actions = _random(env, jax.random.key(2))
    many = jax.jit(jax.vmap(env.step))(first, actions)
    one = jax.jit(env.step)(jax.tree.map(lambda x: x[1], first), actions[1])
    return _judged(
        "vmap", _same(jax.tree.map(lambda x: x[1], many), one),
        "many environments at once step as each does alone",
        "step gives another state under jax.vmap than alone",
    )  # fmt: skip


def _in_picture(env: Completed, states: State) -> Finding:
    far = np.abs(states.objects.center).max()
    return _judged(
        "in the picture", far <= _SLACK * env.half_extent,
        f"boxes stay within half_extent, {env.half_extent:g}",
        f"a box gets to {far:.3g} from the middle, but half_extent, half the width of what a "
        f"picture shows, is {env.half_extent:g}",
        needed=False,
    )  # fmt: skip


def _ends(env: Completed, first: State, states: State) -> Iterator[Finding]:
    begun = float(np.asarray(first.metrics["success"]).mean())
    said = f"{begun:.0%} of the starts already count as success"
    yield Finding("starts unsolved", begun < 0.5, said, needed=False)
    centers = np.asarray(first.objects.center).reshape(_EPISODES, -1)
    distinct = len(np.unique(np.round(centers, 5), axis=0))
    said = f"{distinct} of {_EPISODES} starts are distinct"
    advice = f"{said}: success is counted over distinct starts, so sample them"
    yield _judged("starts differ", distinct > 1, said, advice, needed=False)
    done = np.asarray(states.done)
    early = (done[1:].max(axis=0) > 0).mean()
    how = f"by itself in {early:.0%} of them" if early else "by the time limit"
    yield _judged(
        "episode end", set(np.unique(done)) <= {0.0, 1.0},
        f"episodes of at most {env.episode_length} steps end {how}",
        "done has other numbers than 0 and 1",
    )  # fmt: skip
    if (done * states.metrics["success"]).any():
        yield Finding("end at success", False, _AT_SUCCESS, needed=False)
    if (at_once := done[:2].max(axis=0) > 0).all():
        said = f"all {len(at_once)} episodes end at their first step: done is 1 at the end alone"
        yield Finding("length", False, said)
    success = np.unique(np.asarray(states.metrics["success"]))
    yield _judged(
        "success", set(success) <= {0.0, 1.0}, "success is 0 or 1",
        f"success has {success[0]:g} to {success[-1]:g}, but must be 0 or 1",
    )  # fmt: skip


def _stages(env: Completed, states: State) -> Finding:
    center, size = (x.reshape(-1, *x.shape[2:]) for x in states.objects[:2])
    done = np.asarray(jax.jit(jax.vmap(env.stages.progress))(center, size)) > 0.999
    wrong = float(np.mean(done != (np.asarray(states.metrics["success"]).ravel() > 0.5)))
    return _judged(
        "stages", wrong < 0.01, "stages are all done where success is 1",
        f"stages and success disagree in {wrong:.0%} of the frames", needed=False,
    )  # fmt: skip


def _placed(env: Completed, first: State) -> Finding:
    how = "place(center, size, key)"
    keys = jax.random.split(jax.random.key(0), len(first.objects.center))
    made = jax.jit(jax.vmap(env.place))(first.objects.center, first.objects.size, keys)
    return _judged(
        "place", np.allclose(made.objects.center, first.objects.center, atol=1e-3),
        f"{how} gives a state with the boxes there",
        f"{how} gives a state whose boxes lie elsewhere",
    )  # fmt: skip


def _expert(env: Completed, keys: Any) -> Finding:
    states = jax.device_get(jax.jit(play(env, env.expert))(keys))
    if (bad := not_finite(states)) is not None:
        said = f"{bad} becomes NaN or infinite in the expert's episodes"
        return Finding("expert", False, said)
    success = states.metrics["success"][-1]
    said = f"the expert ends {success.mean():.0%} of {_EPISODES} episodes with success"
    if ends := (states.done[-1] * success).any():
        said = f"{said}; {_AT_SUCCESS}"
    return Finding("expert", bool(success.any() and not ends), said, needed=False)


def _drawing(env: Completed, states: State) -> Finding:
    drawn = env.outlines(jax.tree.map(lambda x: x[0, 0], states.data))
    return _judged("drawing", drawn, "the scene can be drawn", "outlines gives nothing to draw")


def play(env: Completed, expert: Callable[..., Any]) -> Callable[[Any], State]:
    """Episodes of a scripted expert, `(state, key) -> action`, from keys (E,): states with leaves
    (T + 1, E, ...)."""

    def one(state, key):
        return env.step(state, jnp.clip(expert(state, key), -1.0, 1.0))

    def episodes(keys):
        move = lambda s, key: jax.vmap(one)(s, jax.random.split(key, len(keys)))  # noqa: E731
        steps = jax.random.split(jax.random.fold_in(keys[0], 1), env.episode_length)
        return _rolled(move, jax.vmap(env.reset)(keys), steps)

    return episodes
