"""Environments of other libraries as tasks: one of brax, and what has the methods of the others."""

import types
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import of_brax, of_gymnax, of_jumanji
from gril_jax.envs.user_tasks import adapters
from gril_jax.envs.user_tasks.episodes import findings
from gril_jax.envs.user_tasks.protocol import completed
from gril_jax.experiments.examples import brax_wrapper, pushing

SCENE = {
    "objects": pushing.OBJECTS, "robots": pushing.ROBOTS,
    "episode_length": 20, "success": lambda s: jnp.abs(_table(s)[2] - _table(s)[0]).max() < 0.1,
}  # fmt: skip


def _table(state):
    return getattr(state, "pipeline_state", state)


def _boxes(state):
    return pushing.boxes(_table(state))


def _holds(task, *, episodes=False):
    """The task with all members, which plays episodes as it must if these are looked at, too."""
    env = completed(task, Path("here"))
    if not episodes:
        return env
    found = {finding.name: finding for finding in findings(env)}
    assert [f.said for f in found.values() if f.needed and not f.holds] == []
    return env


def _pushes(env, action):
    """The block's way under an action, from the first start."""
    first = jax.jit(env.reset)(jax.random.key(0))
    step = jax.jit(lambda s, _: (env.step(s, action), None))
    last, _ = jax.lax.scan(step, first, length=20)
    return np.asarray(last.objects.center - first.objects.center)


def test_an_environment_of_brax_is_a_task():
    env = _holds(of_brax(brax_wrapper.Pushing(), _boxes, **SCENE), episodes=True)
    assert env.classes == ("goal", "robot", "block")
    way = _pushes(env, jnp.array([1.0, 0.0]))
    assert way[0].tolist() == [0, 0]
    assert way[2, 0] > 0.3


class _Gymnax:
    """The toy world with gymnax's methods, actions from -2 to 2."""

    default_params = types.SimpleNamespace(max_steps_in_episode=20)

    def action_space(self, params):
        return types.SimpleNamespace(low=-2.0, high=2.0, shape=(2,))

    def reset_env(self, key, params):
        return (table := pushing.reset(key)).ravel(), table

    def step_env(self, key, state, action, params):
        table = pushing.step(state, action / 2)
        return table.ravel(), table, 1.0, False, {}


def test_an_environment_of_gymnax_is_a_task_whose_actions_are_scaled():
    scene = {k: v for k, v in SCENE.items() if k != "episode_length"}
    env = _holds(of_gymnax(_Gymnax(), _boxes, **scene))
    assert env.episode_length == 20
    assert _pushes(env, jnp.array([1.0, 0.0]))[2, 0] > 0.3


class _Jumanji:
    """The toy world with Jumanji's methods: four directions, and an end on its fourth step."""

    action_spec = types.SimpleNamespace(num_values=4)

    def _timestep(self, table, time):
        kind = jnp.where(time == 0, 0, jnp.where(time >= 4, 2, 1))
        seen = types.SimpleNamespace(
            step_type=kind, reward=0.0, discount=1.0 - (kind == 2), observation={"table": table}
        )
        return (table, time), seen

    def reset(self, key):
        return self._timestep(pushing.reset(key), jnp.int32(0))

    def step(self, state, action):
        ways = jnp.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        return self._timestep(pushing.step(state[0], ways[action]), state[1] + 1)


def test_an_environment_of_jumanji_is_a_task_whose_choices_are_the_largest_numbers():
    scene = SCENE | {"success": lambda s: s[0][2, 0] > 0.5}
    env = _holds(of_jumanji(_Jumanji(), lambda s: pushing.boxes(s[0]), **scene))
    assert env.action_size == 4
    state = env.reset(jax.random.key(0))
    ends = []
    for _ in range(4):
        state = env.step(state, jnp.array([-1.0, -0.5, 0.9, 0.1]))
        ends.append(float(state.done))
    assert ends == [0, 0, 0, 1]
    way = state.data.own[0][0] - env.reset(jax.random.key(0)).data.own[0][0]
    np.testing.assert_allclose(way[1], [0, 0.2], atol=1e-6)


def test_several_choices_are_each_the_largest_of_theirs():
    actions = adapters._actions(types.SimpleNamespace(num_values=np.array([2, 3])))
    assert actions.size == 5
    assert actions.of(jnp.array([0.0, 1.0, 0.5, 0.9, 0.1])).tolist() == [1, 1]


@pytest.mark.parametrize(
    ("space", "fault"),
    [
        (types.SimpleNamespace(low=-np.inf, high=1.0, shape=(2,)), "has no bounds"),
        (types.SimpleNamespace(shape=(2,)), "cannot be made from numbers"),
    ],
)
def test_actions_without_bounds_are_refused(space, fault):
    with pytest.raises(ValueError, match=fault):
        adapters._actions(space)


def test_a_robot_that_is_no_object_is_refused():
    with pytest.raises(ValueError, match="robots has 'arm', which is none of the objects"):
        of_brax(brax_wrapper.Pushing(), _boxes, **(SCENE | {"robots": ("arm",)}))


def test_an_argument_that_there_is_not_is_told():
    wrong = {name: x for name, x in SCENE.items() if name != "robots"} | {"robot": ("robot",)}
    with pytest.raises(ValueError, match=r"no argument 'robot' \(did you mean 'robots'\?\): they"):
        of_brax(brax_wrapper.Pushing(), _boxes, **wrong)


def test_an_episode_beyond_the_library_s_limit_is_refused():
    with pytest.raises(ValueError, match="episode_length is 30, but the environment ends at 20"):
        of_gymnax(_Gymnax(), _boxes, **(SCENE | {"episode_length": 30}))


@pytest.mark.slow
def test_gymnax_itself():
    gymnax = pytest.importorskip("gymnax", reason="gymnax is not installed")
    env, _ = gymnax.make("PointRobot-misc")

    def boxes(state):
        return jnp.stack([state.goal, state.pos]), jnp.full((2, 2), 0.2)

    scene = {"objects": ("goal", "robot"), "robots": ("robot",), "half_extent": 3.0}
    near = lambda s: jnp.abs(s.goal - s.pos).max() < 0.2  # noqa: E731
    _holds(of_gymnax(env, boxes, success=near, **scene), episodes=True)


@pytest.mark.slow
def test_jumanji_itself():
    jumanji = pytest.importorskip("jumanji", reason="jumanji is not installed")

    def boxes(state):
        places = [state.target_position, state.agent_position]
        cells = jnp.array([[p.col, p.row] for p in places], jnp.float32)
        return cells / 5 - 0.9, jnp.full((2, 2), 0.2)

    def there(state):
        at, target = state.agent_position, state.target_position
        return (at.row == target.row) & (at.col == target.col)

    scene = {"objects": ("target", "agent"), "robots": ("agent",), "success": there}
    _holds(of_jumanji(jumanji.make("Maze-v0"), boxes, **scene), episodes=True)


class _Clock(NamedTuple):
    """A state of either library: its count of steps, and whether the task is done."""

    time: jax.Array
    step_count: jax.Array
    fell: jax.Array


class _Limited:
    """Both libraries' methods: falls after `falls` steps, and says that it is done after six."""

    time_limit, default_params = 6, types.SimpleNamespace(max_steps_in_episode=6)
    action_spec = types.SimpleNamespace(num_values=2)

    def __init__(self, falls, discount=0.0):
        self.falls, self.discount = falls, discount

    def action_space(self, params):
        return types.SimpleNamespace(low=-1.0, high=1.0, shape=(1,))

    def reset_env(self, key, params):
        return jnp.zeros(1), _Clock(jnp.int32(0), jnp.int32(0), jnp.bool_(False))

    def step_env(self, key, state, action, params):
        time = state.time + 1
        state = _Clock(time, time, time >= self.falls)
        return jnp.zeros(1), state, 0.0, state.fell | (time >= 6), {}

    def reset(self, key):
        return self.reset_env(key, None)[1], self._timestep(False)

    def step(self, state, action):
        _, state, _, done, _ = self.step_env(None, state, action, None)
        return state, self._timestep(done)

    def _timestep(self, done):
        kind = jnp.where(done, 2, 1)
        return types.SimpleNamespace(
            step_type=kind, reward=0.0, observation=jnp.zeros(1),
            discount=jnp.where(done, self.discount, 1.0) * jnp.ones(2),  # of two agents
        )  # fmt: skip


@pytest.mark.parametrize("adapt", [of_gymnax, of_jumanji])
def test_a_library_s_time_limit_is_no_end_of_the_task(adapt):
    boxes = lambda state: (jnp.zeros((1, 2)), jnp.ones((1, 2)))  # noqa: E731

    def ends(env):
        task = adapt(env, boxes, objects=("block",), success=lambda state: state.fell)
        assert task.episode_length == 6
        state, found = task.reset(jax.random.key(0)), []
        for _ in range(6):
            state = task.step(state, jnp.zeros(task.action_size))
            found.append(float(state.done))
        return found

    assert ends(_Limited(falls=9)) == [0, 0, 0, 0, 0, 0]
    assert ends(_Limited(falls=4))[3] == 1
    if adapt is of_jumanji:  # an end that Jumanji itself calls a truncation
        assert ends(_Limited(falls=4, discount=1.0)) == [0, 0, 0, 0, 0, 0]
