"""Compiling in a pool: what is ready runs, and what was not begun is given up."""

import threading

import jax
import jax.numpy as jnp
import pytest
from gril_jax.experiments import ahead


def test_what_was_compiled_in_the_pool_runs():
    with ahead.compiling() as pool:
        found = pool.submit(lambda: jax.jit(jnp.sin).lower(1.0).compile()).result()
    assert found(1.0) == jnp.sin(1.0)


def test_what_has_not_begun_when_something_fails_is_given_up(monkeypatch):
    monkeypatch.setattr(ahead.os, "cpu_count", lambda: 2)  # one at a time
    begun, go = threading.Event(), threading.Event()

    def first():
        begun.set()
        return go.wait(60)

    tasks = []

    def block():
        with ahead.compiling() as pool:
            tasks.extend([pool.submit(first), pool.submit(go.wait, 60)])
            begun.wait(60)
            threading.Timer(0.1, go.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block()
    one, other = tasks
    assert one.result() is True
    assert other.cancelled()
