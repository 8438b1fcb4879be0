"""The frame of the benchmarks, and the two wrappings of one pendulum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.bench import frame
from gril_jax.experiments.bench.pendulum import Pendulum, Setting
from gril_jax.experiments.bench.stock import BraxTask, stand_in


def test_calls_take_turns_and_the_first_of_each_is_left_out():
    order = []
    calls = {"a": lambda: order.append("a"), "b": lambda: order.append("b")}
    taken = frame.times_in_turn(calls, 2)
    assert order == ["a", "b"] * 3
    assert [len(times) for times in taken.values()] == [2, 2]


def test_a_compilation_is_counted_once_and_only_inside():
    def double(x):
        return 2 * x

    one = np.ones(3, np.float32)
    with frame.counted() as count:
        compiled = jax.jit(double)
        compiled(one)
        compiled(one)
        assert (count.requests, count.made) == (1, 1)
    compiled(np.ones(4, np.float32))
    assert count.requests == 1


def test_a_program_is_compiled_before_its_first_call():
    call, seconds = frame.compile_timed(lambda x: x + 1, jnp.ones(2))
    np.testing.assert_array_equal(call(jnp.ones(2)), [2, 2])
    assert seconds > 0


def test_the_cache_is_as_it_was_after_it_has_been_off():
    before = jax.config.jax_enable_compilation_cache
    with frame.without_cache():
        assert not jax.config.jax_enable_compilation_cache
    assert jax.config.jax_enable_compilation_cache == before


def test_both_wrappings_of_the_pendulum_move_alike():
    ours, theirs = Pendulum(), BraxTask(Pendulum())
    key, action = jax.random.key(0), jnp.array([0.7])

    def both(key):
        a, b = ours.reset(key), theirs.reset(key)
        for _ in range(3):
            a, b = ours.step(a, action), theirs.step(b, action)
        return (a.obs, a.reward, a.done), (b.obs, b.reward, b.done)

    mine, other = jax.jit(both)(key)
    jax.tree.map(np.testing.assert_array_equal, mine, other)
    assert mine[1] < 0


def test_what_brax_misses_is_there_only_inside():
    assert "device_put_replicated" not in vars(jax)
    with stand_in():
        copies = jax.device_put_replicated({"a": jnp.ones(2)}, jax.local_devices()[:1])
        assert copies["a"].shape == (1, 2)
    assert "device_put_replicated" not in vars(jax)


def test_updates_cover_the_steps_between_two_evaluations():
    setting = Setting(num_timesteps=1000, num_evals=3, num_envs=10, unroll_length=20)
    assert setting.updates == 3  # 500 steps in each of two parts, 200 an update


@pytest.mark.parametrize("side", ["ours", "stock"])
@pytest.mark.slow
def test_both_trainers_answer_with_a_return_for_each_evaluation(side):
    from gril_jax.experiments.bench import ours as bench_ours
    from gril_jax.experiments.bench import stock

    setting = Setting(num_timesteps=320, num_envs=8, num_minibatches=2, hidden=(8,))
    seen = []
    train = {"ours": bench_ours.train, "stock": stock.train}[side]
    returns = train(0, setting, lambda *args: seen.append(args))
    assert len(returns) == len(seen) == 3
    assert [steps for steps, *_ in seen] == [0, 160, 320]
    assert all(-200 * 16.3 < value < 0 for value in returns)
