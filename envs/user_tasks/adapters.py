"""Tasks made of environments of other libraries, with a function from their state to boxes.

    def make():
        env = brax.envs.get_environment("reacher")
        return of_brax(env, boxes, objects=("target", "arm"), robots=("arm",), success=reached)

`boxes(state)` gives the objects' centres and sizes, both (N, 2), in the order of `objects`, which
has the class of each; `success(state)` is true where the task is done. Both see the library's own
state. Whatever else a task may have is given as keywords: `episode_length`, `control_hz`,
`half_extent`, `background`, `stages`, `expert`, `place`, `outlines`, `render`.

None of the libraries is imported: an environment is whatever has their methods.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, State
from gril_jax.envs.checks import nearest
from jaxtyping import Array, Float, PRNGKeyArray

_MEMBERS = (
    "episode_length", "control_hz", "half_extent", "background", "stages", "expert", "place",
    "outlines", "render",
)  # fmt: skip

Boxes = Callable[[Any], tuple[Float[Array, "N 2"], Float[Array, "N 2"]]]
Holds = Callable[[Any], Any]


class Moment(NamedTuple):
    """The outcome of a library's reset or step."""

    state: Any
    obs: Any
    reward: Any
    done: Any


class Actions(NamedTuple):
    """A policy's numbers in [-1, 1] as an action of the library."""

    size: int
    of: Callable[[Float[Array, "A"]], Any]


class Adapted:
    """An environment of another library as a task of one's own."""

    def __init__(
        self,
        begin: Callable[[PRNGKeyArray], Moment],
        advance: Callable[[PRNGKeyArray, Any, Any], Moment],
        actions: Actions,
        boxes: Boxes,
        *,
        objects: Sequence[str],
        success: Holds,
        robots: Sequence[str] = (),
        **more: Any,
    ):
        self._begin, self._advance, self._actions = begin, advance, actions
        self._boxes, self._success = boxes, success
        self.classes = tuple(dict.fromkeys(objects))
        self.action_size = actions.size
        if stray := [name for name in robots if name not in self.classes]:
            raise ValueError(f"robots has {stray[0]!r}, which is none of the objects")
        self._label = np.array([self.classes.index(name) for name in objects], np.int32)
        self._is_robot = np.array([name in robots for name in objects])
        for name, value in more.items():
            if name not in _MEMBERS:
                known = "objects", "success", "robots", *_MEMBERS
                raise ValueError(
                    f"there is no argument {name!r}{nearest(name, known)}: they are "
                    f"{', '.join(known)}"
                )
            setattr(self, name, value)

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts an episode; the state's data is the library's own, and a key for its steps."""
        key, first = jax.random.split(key)
        return self._state(self._begin(first), key)

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """Advances one step of the library."""
        before, key = state.data
        key, now = jax.random.split(key)
        action = self._actions.of(jnp.clip(action, -1.0, 1.0))
        return self._state(self._advance(now, before, action), key)

    def _state(self, moment: Moment, key: PRNGKeyArray) -> State:
        center, size = self._boxes(moment.state)
        seen = Objects(center, size, jnp.asarray(self._label), jnp.asarray(self._is_robot))
        success = jnp.asarray(self._success(moment.state), jnp.float32)
        done, reward = (jnp.asarray(x, jnp.float32) for x in (moment.done, moment.reward))
        data, obs = (moment.state, key), _vector(moment.obs)
        return State(data, obs, seen, reward=reward, done=done, metrics={"success": success})


def of_brax(env: Any, boxes: Boxes, **scene: Any) -> Adapted:
    """A task of an environment of brax or MuJoCo Playground; `scene` is that of `Adapted`."""

    def moment(state: Any) -> Moment:
        return Moment(state, state.obs, state.reward, state.done)

    def begin(key: PRNGKeyArray) -> Moment:
        return moment(env.reset(jax.random.key_data(key)))  # it wants keys of the older kind

    def advance(key: PRNGKeyArray, state: Any, action: Any) -> Moment:
        return moment(env.step(state, action))

    return Adapted(begin, advance, Actions(env.action_size, lambda x: x), boxes, **scene)


def of_gymnax(env: Any, boxes: Boxes, *, params: Any = None, **scene: Any) -> Adapted:
    """A task of an environment of gymnax; its own automatic reset is not used."""
    params = env.default_params if params is None else params
    limit = getattr(params, "max_steps_in_episode", None)

    def begin(key: PRNGKeyArray) -> Moment:
        obs, state = env.reset_env(key, params)
        return Moment(state, obs, 0.0, 0.0)

    def advance(key: PRNGKeyArray, state: Any, action: Any) -> Moment:
        obs, state, reward, done, _ = env.step_env(key, state, action, params)
        return Moment(state, obs, reward, _by_itself(done, getattr(state, "time", None), limit))

    scene = _within(limit, scene)
    return Adapted(begin, advance, _actions(env.action_space(params)), boxes, **scene)


def of_jumanji(env: Any, boxes: Boxes, **scene: Any) -> Adapted:
    """A task of an environment of Jumanji."""
    limit = getattr(env, "time_limit", None)

    def moment(state: Any, timestep: Any) -> Moment:
        last = timestep.step_type == 2  # of dm_env, whose discount is 1 where the value goes on
        ended = last & jnp.all(jnp.asarray(timestep.discount) == 0)
        ended = _by_itself(ended, getattr(state, "step_count", None), limit)
        return Moment(state, timestep.observation, timestep.reward, ended)

    def begin(key: PRNGKeyArray) -> Moment:
        return moment(*env.reset(key))

    def advance(key: PRNGKeyArray, state: Any, action: Any) -> Moment:
        return moment(*env.step(state, action))

    spec = env.action_spec() if callable(env.action_spec) else env.action_spec
    scene = _within(limit, scene)
    return Adapted(begin, advance, _actions(spec), boxes, **scene)


def _within(limit: Any, scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with the library's time limit as its `episode_length`; a ValueError for a longer
    one, at which the library would end episodes by itself."""
    if limit is None:
        return scene
    scene = {"episode_length": int(limit)} | scene
    if scene["episode_length"] > limit:
        raise ValueError(
            f"episode_length is {scene['episode_length']}, but the environment ends at {limit} "
            "steps: give it a longer limit, too"
        )
    return scene


def _by_itself(done: Any, time: Any, limit: Any) -> Any:
    """True if the task has ended, and not only its time: at the library's limit, which is the
    task's `episode_length`, the episode is cut off, and its value goes on."""
    return done if time is None or limit is None else jnp.asarray(done, bool) & (time != limit)


def _actions(space: Any) -> Actions:
    """Actions of a space: the largest of N numbers chooses among N, others are scaled to bounds."""
    choices = getattr(space, "num_values", getattr(space, "n", None))
    if choices is not None:
        counts = np.atleast_1d(np.asarray(choices)).reshape(-1)
        ends, shape = np.cumsum(counts)[:-1], np.shape(choices)

        def choose(action: Float[Array, "A"]) -> Any:
            parts = [jnp.argmax(part) for part in jnp.split(action, ends)]
            return jnp.stack(parts).astype(jnp.int32).reshape(shape)

        return Actions(int(counts.sum()), choose)
    low, high = (getattr(space, a, getattr(space, b, None)) for a, b in _BOUNDS)
    if low is None or high is None:
        raise ValueError(f"actions of a {type(space).__name__} cannot be made from numbers")
    low, high = (np.broadcast_to(np.asarray(x, np.float32), space.shape) for x in (low, high))
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError(
            "the action space has no bounds that numbers in [-1, 1] could be scaled to"
        )

    def scale(action: Float[Array, "A"]) -> Any:
        return low + (action.reshape(low.shape) + 1) / 2 * (high - low)

    return Actions(max(1, low.size), scale)


_BOUNDS = (("low", "minimum"), ("high", "maximum"))


def _vector(obs: Any) -> Float[Array, "O"]:
    """An observation as one vector; of a dictionary with "state", as Playground has, that part."""
    if isinstance(obs, dict) and "state" in obs:
        obs = obs["state"]
    return jnp.concatenate([jnp.ravel(x).astype(jnp.float32) for x in jax.tree.leaves(obs)])
