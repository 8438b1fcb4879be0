"""The frame of the benchmarks."""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.bench import frame


def test_calls_take_turns_and_the_first_of_each_is_left_out():
    order = []
    calls = {"a": lambda: order.append("a"), "b": lambda: order.append("b")}
    taken = frame.times_in_turn(calls, 2)
    assert order == ["a", "b"] * 3
    assert [len(times) for times in taken.values()] == [2, 2]


def test_a_program_is_compiled_before_its_first_call():
    call, seconds = frame.compile_timed(lambda x: x + 1, jnp.ones(2))
    np.testing.assert_array_equal(call(jnp.ones(2)), [2, 2])
    assert seconds > 0


def test_the_cache_is_as_it_was_after_it_has_been_off():
    before = jax.config.jax_enable_compilation_cache
    with frame.without_cache():
        assert not jax.config.jax_enable_compilation_cache
    assert jax.config.jax_enable_compilation_cache == before
