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


def findings(env: Completed) -> Iterator[Finding]:
    """Every point that needs episodes, in turn; `env` has passed `completed`."""
    keys = jax.random.split(jax.random.key(0), _EPISODES)
    first = jax.jit(jax.vmap(env.reset))(keys)
    yield _pure(env, keys, first)
    yield _vmapped(env, keys, first)
    states = jax.device_get(jax.jit(lambda: _played(env, keys))())
    bad = not_finite(states)
    random = f"{_EPISODES} episodes of random actions"
    yield Finding(
        "finite", bad is None,
        f"all numbers stay finite in {random}" if bad is None
        else f"{bad} becomes NaN or infinite in {random}",
    )  # fmt: skip
    yield _in_picture(env, states)
    yield from _ends(env, first, states)
    yield _moves(states)
    if env.stages is not None:
        yield _stages(env, states)
    if env.place is not None:
        yield _placed(env, first)
    if env.expert is not None:
        yield _expert(env, keys)


def _played(env: Completed, keys: Any) -> State:
    """Whole episodes of random actions, leaves (T + 1, E, ...)."""

    def move(states, key):
        actions = jax.random.uniform(key, (_EPISODES, env.action_size), minval=-1.0)
        states = jax.vmap(env.step)(states, actions)
        return states, states

    first = jax.vmap(env.reset)(keys)
    _, after = jax.lax.scan(move, first, jax.random.split(jax.random.key(1), env.episode_length))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, after)


def _same(a: Any, b: Any) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    numbers = [(x, y) for x, y in pairs if not jnp.issubdtype(x.dtype, jax.dtypes.prng_key)]
    close = [np.allclose(x, y, rtol=1e-4, atol=1e-5, equal_nan=True) for x, y in numbers]
    return all(close)


def _pure(env: Completed, keys: Any, first: State) -> Finding:
    again = jax.jit(jax.vmap(env.reset))(keys)
    with jax.disable_jit(False):
        alone = env.reset(keys[0])
    one = jax.tree.map(lambda x: x[0], first)
    holds = _same(first, again) and _same(one, alone)
    return Finding(
        "pure", holds,
        "the same key gives the same start, compiled or not" if holds
        else "the same key gives different starts: reset may use its key alone, and keep nothing",
    )  # fmt: skip


def _vmapped(env: Completed, keys: Any, first: State) -> Finding:
    actions = jax.random.uniform(jax.random.key(2), (_EPISODES, env.action_size), minval=-1.0)
    many = jax.jit(jax.vmap(env.step))(first, actions)
    one = jax.jit(env.step)(jax.tree.map(lambda x: x[1], first), actions[1])
    holds = _same(jax.tree.map(lambda x: x[1], many), one)
    return Finding(
        "vmap", holds,
        "many environments at once step as each does alone" if holds
        else "step gives another state under jax.vmap than alone",
    )  # fmt: skip


def _in_picture(env: Completed, states: State) -> Finding:
    far = np.abs(states.objects.center).max()
    inside = far <= _SLACK * env.half_extent
    return Finding(
        "in the picture", bool(inside),
        f"boxes stay within half_extent, {env.half_extent:g}" if inside
        else f"a box gets to {far:.3g} from the middle, but half_extent, half the width of what a "
        f"picture shows, is {env.half_extent:g}",
        needed=False,
    )  # fmt: skip


def _ends(env: Completed, first: State, states: State) -> Iterator[Finding]:
    begun = float(np.asarray(first.metrics["success"]).mean())
    yield Finding(
        "starts unsolved", begun < 0.5,
        f"{begun:.0%} of the starts are solved already", needed=False,
    )  # fmt: skip
    centers = np.asarray(first.objects.center).reshape(_EPISODES, -1)
    distinct = len(np.unique(np.round(centers, 5), axis=0))
    yield Finding(
        "starts differ", distinct > 1,
        f"{distinct} of {_EPISODES} starts are distinct"
        + ("" if distinct > 1 else ": success is counted over distinct starts, so draw them"),
        needed=False,
    )  # fmt: skip
    done = np.asarray(states.done)
    kinds = set(np.unique(done)) <= {0.0, 1.0}
    early = (done[1:].max(axis=0) > 0).mean()
    how = f"by itself in {early:.0%} of them" if early else "by the time limit"
    yield Finding(
        "episode end", kinds,
        f"episodes of at most {env.episode_length} steps end {how}" if kinds
        else "done has other numbers than 0 and 1",
    )  # fmt: skip
    success = np.unique(np.asarray(states.metrics["success"]))
    yield Finding(
        "success", set(success) <= {0.0, 1.0},
        "success is 0 or 1" if set(success) <= {0.0, 1.0}
        else f"success has {success[0]:g} to {success[-1]:g}, but must be 0 or 1",
    )  # fmt: skip


def _moves(states: State) -> Finding:
    label, robot = states.objects.label, states.objects.is_robot
    still = (label == label[:1]).all() and (robot == robot[:1]).all()
    return Finding(
        "labels stay", bool(still),
        "label and is_robot stay the same" if still
        else "label or is_robot changes in an episode, but says what an object is",
    )  # fmt: skip


def _stages(env: Completed, states: State) -> Finding:
    center, size = (x.reshape(-1, *x.shape[2:]) for x in states.objects[:2])
    done = np.asarray(jax.jit(jax.vmap(env.stages.progress))(center, size)) > 0.999
    wrong = float(np.mean(done != (np.asarray(states.metrics["success"]).ravel() > 0.5)))
    return Finding(
        "stages", wrong < 0.01,
        "stages are all done where success is 1" if wrong < 0.01
        else f"stages and success disagree in {wrong:.0%} of the frames",
        needed=False,
    )  # fmt: skip


def _placed(env: Completed, first: State) -> Finding:
    try:
        keys = jax.random.split(jax.random.key(0), len(first.objects.center))
        made = jax.jit(jax.vmap(env.place))(first.objects.center, first.objects.size, keys)
    except Exception as error:
        return Finding(
            "place",
            False,
            f"place(center, size, key) fails ({type(error).__name__}: {error!s:.100})",
        )
    holds = np.allclose(made.objects.center, first.objects.center, atol=1e-3)
    return Finding(
        "place", holds,
        "place(center, size, key) gives a state with the boxes there" if holds
        else "place(center, size, key) gives a state whose boxes lie elsewhere",
    )  # fmt: skip


def _expert(env: Completed, keys: Any) -> Finding:
    from_start = play(env, env.expert)
    success = np.asarray(jax.jit(from_start)(keys).metrics["success"])[-1]
    share = float(success.mean())
    return Finding(
        "expert", share > 0,
        f"the expert ends {share:.0%} of {_EPISODES} episodes with success",
        needed=False,
    )  # fmt: skip


def play(env: Completed, expert: Callable[..., Any]) -> Callable[[Any], State]:
    """Episodes of a scripted expert from keys (E,): states with leaves (T + 1, E, ...).

    The expert, `(state, key) -> action`, sees the user's own states.
    """

    def one(state, key):
        action = expert(state._replace(data=state.data.own), key)
        return env.step(state, jnp.clip(jnp.asarray(action, jnp.float32), -1.0, 1.0))

    def episodes(keys):
        def move(states, key):
            states = jax.vmap(one)(states, jax.random.split(key, len(keys)))
            return states, states

        first = jax.vmap(env.reset)(keys)
        steps = jax.random.split(jax.random.fold_in(keys[0], 1), env.episode_length)
        _, after = jax.lax.scan(move, first, steps)
        return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, after)

    return episodes
