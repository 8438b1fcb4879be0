"""The contract of one's own task: what is filled in, refused in a sentence, and found."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import registry
from gril_jax.envs.user_tasks import episodes
from support import own_task

from gril_jax import envs


def _made(tmp_path, **changed):
    return envs.make(f"{own_task.write(tmp_path, **changed)}:make")


def test_what_a_task_leaves_open_is_filled_in(tmp_path):
    env = _made(tmp_path)
    assert isinstance(env, envs.Env)
    assert (env.episode_length, env.control_hz, env.half_extent) == (8, 10.0, 1.0)
    assert (env.observation_size, env.action_size) == (2, 2)
    state = jax.jit(env.reset)(jax.random.key(0))
    assert state.moved.tolist() == [False] * 3
    assert (float(state.reward), float(state.done)) == (0.0, 0.0)
    assert set(state.metrics) == {"score", "success"}
    after = jax.jit(env.step)(state, jnp.ones(2))
    assert jax.tree.structure(after) == jax.tree.structure(state)
    for a, b in zip(jax.tree.leaves(state), jax.tree.leaves(after), strict=True):
        assert (a.dtype, a.weak_type) == (b.dtype, b.weak_type) == (a.dtype, False)
    np.testing.assert_allclose(after.data.own, jnp.clip(state.data.own + 0.2, -0.9, 0.9))


def test_what_has_moved_may_be_one_flag_for_all(tmp_path):
    env = _made(tmp_path, change=("seen, metrics", "seen, moved=False, metrics"))
    assert jax.jit(env.reset)(jax.random.key(0)).moved.tolist() == [False] * 3


def test_a_partial_function_makes_a_task(tmp_path):
    made = (
        "def make(speed=1.0):\n    return Task()",
        (
            "import functools\n\ndef _made(speed):\n    return Task()\n\n"
            "make = functools.partial(_made, speed=1.0)"
        ),
    )
    name = f"{own_task.write(tmp_path, change=made)}:make"
    assert envs.make(name, speed=2.0).classes == own_task.CLASSES
    with pytest.raises(ValueError, match="make has no option 'sped'"):
        envs.make(name, sped=2.0)


def test_a_reward_of_the_task_s_own_is_known(tmp_path):
    assert not _made(tmp_path).rewarded
    assert _made(tmp_path, change=("seen, metrics", "seen, reward=puck[0], metrics")).rewarded


def test_boxes_are_drawn_where_a_task_cannot_draw_itself(tmp_path):
    env = _made(tmp_path)
    state = env.reset(jax.random.key(0))
    drawn = env.outlines(jax.device_get(state.data))
    assert len(drawn) == 3
    middles = sorted(outline.vertices.mean(axis=0).tolist() for outline in drawn)
    np.testing.assert_allclose(middles, sorted(state.objects.center.tolist()), atol=1e-6)


_SEEN = "seen = Objects(center, jnp.full((3, 2), 0.2), jnp.arange(3), jnp.arange(3) == 1)"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('classes = ("mat", "hand", "puck")', "", "has no `classes`"),
        ('classes = ("mat", "hand", "puck")', 'classes = "mat"', "classes is 'mat', but must be a"),
        ('"hand", "puck")', '"mat")', "must be a tuple of different, printable names"),
        ("    def step(", "    def stepp(", "has no `step`"),
        ("action_size, episode_length = 2, 8", "action_size = 0", "action_size is 0, but must be"),
        ("episode_length = 2, 8", "episode_length = 2, 0.5", "episode_length is 0.5"),
        ("return Task()", "raise OSError('gone')", "make failed at line 25: OSError: gone"),
        ("return Task()", "return None", "the task, a NoneType, has no `classes`"),
        ("State(puck, puck, seen,", "State(puck, puck, puck,", "returns objects without `center`"),
        (_SEEN, _SEEN.replace("(3, 2), 0.2", "(2, 2), 0.2"), r"objects.size has the"),
        (_SEEN, _SEEN.replace("center,", "center[:, :1],"), "objects.center has the shape"),
        (_SEEN, _SEEN.replace("jnp.arange(3),", "1 + jnp.arange(3),"), "objects.label has 3, but"),
        (_SEEN, _SEEN.replace("0.2)", "0.0)"), "objects.size must be above 0"),
        ("State(puck, puck,", "State(puck, puck[0],", "but must be a vector"),
        ('{"success"', '{"succes"', "metrics has no 'success'"),
        ("jnp.clip(state.data", "puck if action[0] > 0 else (state.data", "step fails as JAX"),
        ("center = jnp", "puck = jnp.log(puck - 2)\n        center = jnp", "NaN or infinity in"),
        ("0.2 * action, -0.9, 0.9)", "jnp.log(action - 1), -0.9, jnp.nan)", "step gives a"),
        ("jnp.clip(state.data + 0.2 * action, -0.9, 0.9)", "state.data[:1]", "step"),
        ("{\"success\": (jnp.abs(puck) < 0.3).all()}", "{\"success\": puck}", "must be one number"),
        ("metrics={", "moved=jnp.zeros(2, bool), metrics={", r"moved has the shape \(2,\), but"),
        ("    def expert(", "    def place(self, center, size, key):\n"
         "        return self.state(center[2])._replace(data=center)\n\n    def expert(",
         r"float32 \(2,\) after reset and float32 \(3, 2\) after place"),
    ],
)  # fmt: skip
def test_what_breaks_the_contract_is_one_sentence(tmp_path, old, new, fault):
    path = own_task.write(tmp_path, change=(old, new))
    with pytest.raises(ValueError, match=fault) as caught:
        envs.make(f"{path}:make")
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_options_are_those_of_the_function(tmp_path):
    path = own_task.write(tmp_path)
    assert registry.spec(f"{path}:make").rewards == ()
    assert envs.make(f"{path}:make", speed=2.0).classes == own_task.CLASSES
    assert envs.options(f"{path}:make") == {"speed"}
    with pytest.raises(
        ValueError, match=r"has no option 'sped' \(did you mean 'speed'\?\): it takes"
    ):
        envs.make(f"{path}:make", sped=2.0)


def _found(env):
    return {finding.name: finding for finding in episodes.findings(env)}


def test_a_task_that_keeps_the_contract_lacks_nothing(tmp_path):
    found = _found(_made(tmp_path))
    assert all(finding.holds for finding in found.values())
    assert found["expert"].said == "the expert ends 100% of 16 episodes with success"


@pytest.mark.parametrize(
    ("old", "new", "name", "said"),
    [
        ("-0.9, 0.9)", "-9, 9)", "in the picture", "half_extent, half the width"),
        ("jax.random.uniform(key, (2,), minval=-0.8, maxval=0.8)", "jnp.ones(2)", "starts differ",
         "1 of 16 starts are distinct: success is counted over distinct starts"),
        ("minval=-0.8, maxval=0.8", "maxval=0.1", "starts unsolved", "100% of the starts"),
        ("(jnp.abs(puck) < 0.3).all()", "jnp.abs(puck).max()", "success", "but must be 0 or 1"),
        ("return -5 * state.data", "return 5 * state.data", "expert", "ends 0% of 16"),
        ("seen, metrics", "seen, done=(jnp.abs(puck) < 0.3).all() * 1.0, metrics", "expert",
         "100% of 16 episodes with success; episodes end at success, after which"),
        ("seen, metrics", "seen, done=(jnp.abs(puck) < 0.3).all() * 1.0, metrics",
         "end at success", "--run.reward-offset 0 makes it 0 and less"),
        ("seen = Obj", "center = jnp.where(puck[0] > 0.85, jnp.nan, center)\n        seen = Obj",
         "finite", "becomes NaN or infinite"),
    ],
)  # fmt: skip
def test_what_only_episodes_show_is_found(tmp_path, old, new, name, said):
    found = _found(_made(tmp_path, change=(old, new)))[name]
    assert not found.holds
    assert said in found.said


def test_a_start_that_does_not_depend_on_its_key_alone_is_found(tmp_path):
    change = ("return self.state(jax.random.uniform(key", "self.n = getattr(self, 'n', 0) + 1\n"
              "        return self.state(self.n * 0.01 + jax.random.uniform(key")  # fmt: skip
    assert not _found(_made(tmp_path, change=change))["pure"].holds


def test_what_follows_the_end_of_a_task_is_not_judged(tmp_path):
    """The puck falls to where its height has no logarithm; an expert drives on after success."""
    done = (
        "State(puck, puck, seen,",
        ("State(puck, puck, seen, done=jnp.asarray((puck[0] < 0.3) * 1.0),"),
    )
    falls = "state.data + 0.2 * action, -0.9, 0.9)", "state.data - 0.3, -9.0, 0.9) + 0 * action"
    deep = "seen = Objects(center,", "seen = Objects(center + 0 * jnp.log(puck[0] + 0.4),"
    start = "minval=-0.8, maxval=0.8", "minval=0.4, maxval=0.8"
    found = _found(_made(tmp_path, one=done, two=falls, three=deep, four=start))
    assert found["finite"].holds
    ends = "(jnp.abs(puck) < 0.3).all()", "(puck[0] < 0.3) & (puck[0] > 0.0)"
    on = "return -5 * state.data", "return -jnp.ones(2)"
    found = _found(_made(tmp_path, one=done, two=ends, three=on, four=start))
    assert "ends 100% of 16" in found["expert"].said
