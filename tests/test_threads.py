"""Results in order, few items begun ahead, and a failure where its result would be."""

import os
import threading

import pytest

from gril_jax import threads as module
from gril_jax.threads import parallel_map


@pytest.mark.parametrize("cores", [1, 3, 50])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_results_are_those_of_a_loop(monkeypatch, cores, count):
    monkeypatch.setattr(module, "cores", lambda: cores)
    assert list(parallel_map(lambda x: x * x, range(count))) == [x * x for x in range(count)]


def test_few_items_are_begun_before_their_results_are_taken(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 2)
    drawn = []
    results = parallel_map(lambda x: x, (drawn.append(x) or x for x in range(100)))
    assert drawn == []
    assert [next(results), next(results)] == [0, 1]
    assert len(drawn) <= 4
    results.close()


def test_a_failure_comes_in_its_place_and_ends_the_rest(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 2)
    begun, threads = [], set()

    def divide(x):
        begun.append(x)
        threads.add(threading.current_thread())
        return 6 // x

    results = parallel_map(divide, [3, 2, 0, *range(1, 50)])
    assert [next(results), next(results)] == [2, 3]
    with pytest.raises(ZeroDivisionError):
        list(results)
    assert len(begun) < 10
    assert not any(thread.is_alive() for thread in threads)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux binds processes to cores")
def test_cores_are_those_that_the_process_is_bound_to():
    mine = os.sched_getaffinity(0)
    assert module.cores() == len(mine)
    try:
        os.sched_setaffinity(0, {min(mine)})
        assert module.cores() == 1
    finally:
        os.sched_setaffinity(0, mine)
