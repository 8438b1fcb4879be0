"""The contract of a task of one's own, each point a finding in a sentence.

`first_fault` looks at what can be seen in a second or two, before every work; `findings` plays
episodes, too, and is for `gril check-task`.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import State

from .completed import USUAL, Completed, complete
from .files import fault

_EPISODES = 16
_SLACK = 1.05  # of the picture, in which a box's centre may lie


class Finding(NamedTuple):
    """One point of the contract."""

    name: str
    holds: bool
    said: str  # a sentence
    needed: bool = True  # nothing works without it


def completed(task: Any, file: Path) -> Completed:
    """The user's task with all members of the contract; a ValueError of one sentence for the first
    thing that is missing or wrong."""
    for check in (_members, _state, _step, _numbers):
        said = check(task, file)
        if said:
            raise ValueError(f"{file}: {said}")
    return Completed(task)


def _members(task: Any, file: Path) -> str | None:
    """A sentence if an attribute is missing or not of its kind."""
    for name in ("classes", "action_size", "reset", "step"):
        if not hasattr(task, name):
            return f"the task, a {type(task).__name__}, has no `{name}`"
    classes = task.classes
    if isinstance(classes, str) or not _names(classes):
        return f"classes is {classes!r:.80}, but must be a tuple of different names"
    sizes = {"action_size": task.action_size, "episode_length": _usual(task, "episode_length")}
    for name, value in sizes.items():
        if not (isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= 1):
            return f"{name} is {value!r:.40}, but must be a whole number of at least 1"
    for name in ("control_hz", "half_extent"):
        value = _usual(task, name)
        if not (isinstance(value, int | float) and 0 < value < float("inf")):
            return f"{name} is {value!r:.40}, but must be a number above 0"
    return None


def _usual(task: Any, name: str) -> Any:
    return getattr(task, name, USUAL[name])


def _names(classes: Any) -> bool:
    try:
        names = tuple(classes)
    except TypeError:
        return False
    return bool(names) and all(type(n) is str and n.strip() for n in names) and (
        len({*names}) == len(names)
    )  # fmt: skip


def _state(task: Any, file: Path) -> str | None:
    """A sentence if `reset` cannot be traced, or its state is not as it must be."""
    try:
        state = jax.eval_shape(task.reset, jax.random.key(0))
    except Exception as error:
        return f"reset cannot be compiled by JAX ({fault(error, file)})"
    return _shapes(state, "reset")


def _shapes(state: Any, method: str) -> str | None:
    for name in ("data", "obs", "objects", "metrics"):
        if not hasattr(state, name):
            return f"{method} returns a {type(state).__name__} without `{name}`"
    for name in ("center", "size", "label", "is_robot"):
        if not hasattr(state.objects, name):
            return f"{method} returns objects without `{name}`"
    center = np.shape(state.objects.center)
    if len(center) != 2 or center[1] != 2 or not center[0]:
        return f"{method}: objects.center has the shape {center}, but must be (objects, 2)"
    wanted = {"size": center, "label": center[:1], "is_robot": center[:1]}
    for name, shape in wanted.items():
        found = np.shape(getattr(state.objects, name))
        if found != shape:
            return f"{method}: objects.{name} has the shape {found}, but must be {shape}"
    if len(np.shape(state.obs)) != 1:
        return f"{method}: obs has the shape {np.shape(state.obs)}, but must be a vector"
    if "success" not in state.metrics:
        return f"{method}: metrics has no 'success', 1 where the task is done and 0 elsewhere"
    numbers = {name: getattr(state, name, 0.0) for name in ("reward", "done")}
    for name, value in {**numbers, **state.metrics}.items():
        if np.shape(value) != ():
            return f"{method}: {name} has the shape {np.shape(value)}, but must be one number"
    return None


def _step(task: Any, file: Path) -> str | None:
    """A sentence if `step` cannot be traced, or gives another structure than `reset`."""

    def both(key, action):
        first = task.reset(key)
        whole = complete(first)
        after = task.step(whole._replace(data=whole.data.own), action)
        return whole, after

    action = jnp.zeros(task.action_size)
    try:
        first, after = jax.eval_shape(both, jax.random.key(0), action)
    except Exception as error:
        return f"step cannot be compiled by JAX ({fault(error, file)})"
    said = _shapes(after, "step")
    if said:
        return said
    after = jax.eval_shape(complete, after)
    if jax.tree.structure(first) != jax.tree.structure(after):
        return "step returns another structure than reset: the same fields must be in both states"
    pairs = zip(jax.tree.leaves_with_path(first), jax.tree.leaves(after), strict=True)
    for (path, a), b in pairs:
        if (a.shape, a.dtype) != (b.shape, b.dtype):
            return (
                f"state{jax.tree_util.keystr(path).replace('.own', '')} is {a.str_short()} after "
                f"reset and {b.str_short()} after step, but must be the same"
            )
    return None


def _numbers(task: Any, file: Path) -> str | None:
    """A sentence if the first two states hold what they must not."""
    whole = Completed(task)
    action = jnp.zeros(task.action_size)
    try:
        first = jax.jit(whole.reset)(jax.random.key(0))
        states = {"reset": first, "step": jax.jit(whole.step)(first, action)}
    except Exception as error:
        return f"an episode cannot be begun ({fault(error, file)})"
    for method, state in states.items():
        if (bad := not_finite(state)) is not None:
            return f"{method} gives a state with NaN or infinity in {bad}"
        label = np.asarray(state.objects.label)
        if label.min() < 0 or label.max() >= len(whole.classes):
            wrong = label.max() if label.min() >= 0 else label.min()
            return (
                f"{method}: objects.label has {int(wrong)}, but must be from 0 to "
                f"{len(whole.classes) - 1}, an index into classes"
            )
        if (np.asarray(state.objects.size) <= 0).any():
            return f"{method}: objects.size must be above 0, for a box has a width and a height"
    return None


def not_finite(state: State) -> str | None:
    """The first leaf with a number that is not finite, as `state.obs`; None if there is none."""
    for path, leaf in jax.tree.leaves_with_path(state):
        floats = jnp.issubdtype(leaf.dtype, jnp.floating)
        if floats and not np.isfinite(np.asarray(leaf, np.float64)).all():
            return f"state{jax.tree_util.keystr(path).replace('.own', '')}"
    return None


# --- what takes episodes to see


def _judged(name: str, holds: Any, yes: str, no: str, *, needed: bool = True) -> Finding:
    return Finding(name, bool(holds), yes if holds else no, needed)


def findings(env: Completed) -> Iterator[Finding]:
    """Every point that needs episodes, in turn; `env` has passed `completed`."""
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
    yield _in_picture(env, states)
    yield from _ends(env, first, states)
    label, robot = states.objects.label, states.objects.is_robot
    yield _judged(
        "labels stay", (label == label[:1]).all() and (robot == robot[:1]).all(),
        "label and is_robot stay the same",
        "label or is_robot changes in an episode, but says what an object is",
    )  # fmt: skip
    if env.stages is not None:
        yield _stages(env, states)
    if env.place is not None:
        yield _placed(env, first)
    if env.expert is not None:
        success = np.asarray(jax.jit(play(env, env.expert))(keys).metrics["success"])[-1]
        said = f"the expert ends {success.mean():.0%} of {_EPISODES} episodes with success"
        yield Finding("expert", bool(success.mean() > 0), said, needed=False)


def _random(env: Completed, key: Any) -> Any:
    return jax.random.uniform(key, (_EPISODES, env.action_size), minval=-1.0)


def _played(env: Completed, keys: Any) -> State:
    """Whole episodes of random actions, leaves (T + 1, E, ...)."""
    steps = jax.random.split(jax.random.key(1), env.episode_length)
    move = lambda states, key: jax.vmap(env.step)(states, _random(env, key))  # noqa: E731
    return _rolled(move, jax.vmap(env.reset)(keys), steps)


def _rolled(move: Callable[[State, Any], State], first: State, keys: Any) -> State:
    """All states from the first on, one move for each key: leaves (T + 1, E, ...)."""
    _, after = jax.lax.scan(lambda states, key: (move(states, key),) * 2, first, keys)
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
    try:
        keys = jax.random.split(jax.random.key(0), len(first.objects.center))
        made = jax.jit(jax.vmap(env.place))(first.objects.center, first.objects.size, keys)
    except Exception as error:
        return Finding("place", False, f"{how} fails ({type(error).__name__}: {error!s:.100})")
    return _judged(
        "place", np.allclose(made.objects.center, first.objects.center, atol=1e-3),
        f"{how} gives a state with the boxes there",
        f"{how} gives a state whose boxes lie elsewhere",
    )  # fmt: skip


def play(env: Completed, expert: Callable[..., Any]) -> Callable[[Any], State]:
    """Episodes of a scripted expert from keys (E,): states with leaves (T + 1, E, ...).

    The expert, `(state, key) -> action`, sees the user's own states.
    """

    def one(state, key):
        action = expert(state._replace(data=state.data.own), key)
        return env.step(state, jnp.clip(jnp.asarray(action, jnp.float32), -1.0, 1.0))

    def episodes(keys):
        move = lambda s, key: jax.vmap(one)(s, jax.random.split(key, len(keys)))  # noqa: E731
        steps = jax.random.split(jax.random.fold_in(keys[0], 1), env.episode_length)
        return _rolled(move, jax.vmap(env.reset)(keys), steps)

    return episodes
