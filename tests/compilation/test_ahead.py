"""Compiling in a pool: what is ready runs, and what was not begun is given up."""

import threading

import jax
import jax.numpy as jnp
import pytest

from gril_jax.compilation import ahead


@pytest.mark.parametrize("cores", [2, 4])
def test_what_was_compiled_in_the_pool_runs(monkeypatch, cores):
    monkeypatch.setattr(ahead.threads, "cores", lambda: cores)
    with ahead.compiling() as pool:
        found = pool.submit(lambda: jax.jit(jnp.sin).lower(1.0).compile()).result()
    assert found(1.0) == jnp.sin(1.0)


def test_what_has_not_begun_when_something_fails_is_given_up(monkeypatch):
    monkeypatch.setattr(ahead.threads, "cores", lambda: 4)
    begun, go = threading.Event(), threading.Event()

    def first():
        begun.set()
        return go.wait(60)

    tasks = []

    def block():
        with ahead.compiling() as pool:
            tasks.extend([pool.submit(f) for f in (first, first, go.wait)])  # two at a time
            begun.wait(60)
            threading.Timer(0.1, go.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block()
    one, _, other = tasks
    assert one.result() is True
    assert other.cancelled()


@pytest.mark.parametrize(("cores", "processes"), [(2, 1), (16, 2)])
def test_on_two_cores_or_hosts_each_is_made_once_and_when_it_is_asked_for(
    monkeypatch, cores, processes
):
    monkeypatch.setattr(ahead.threads, "cores", lambda: cores)
    monkeypatch.setattr(ahead.jax, "process_count", lambda: processes)
    made = []
    with ahead.compiling() as pool:
        tasks = [pool.submit(made.append, name) for name in "abc"]
        assert made == []
        for task in (tasks[1], tasks[0], tasks[1]):
            task.result()
    assert made == ["b", "a"]


def test_programs_are_traced_one_by_one_and_compiled_side_by_side(monkeypatch):
    monkeypatch.setattr(ahead.threads, "cores", lambda: 8)
    traced, both = [], threading.Barrier(2)

    def make(name):
        with ahead.tracing():
            traced.append(name)
            traced.append(name)  # nobody comes in between
        both.wait(60)  # passes only if the other has been traced meanwhile
        return name

    with ahead.compiling() as pool:
        assert [task.result() for task in [pool.submit(make, x) for x in "ab"]] == ["a", "b"]
    assert traced in (["a", "a", "b", "b"], ["b", "b", "a", "a"])


@pytest.mark.parametrize("cores", [2, 8])
def test_tasks_come_after_those_that_they_need(monkeypatch, cores):
    monkeypatch.setattr(ahead.threads, "cores", lambda: cores)
    done = []
    with ahead.compiling() as pool:
        programs = {name: pool.submit(lambda name=name: name) for name in "abc"}

        def task(name, *needs):
            do = lambda: done.append(programs[name].result())  # noqa: E731
            return ahead.Task(name, programs[name], frozenset(needs), do)

        ahead.carry_out(
            [
                task("a", "b", "c"),
                ahead.Task("d", None, frozenset("a"), lambda: done.append("d")),
                task("b", "c"),
                task("c"),
            ]
        )
    assert done == ["c", "b", "a", "d"]


def test_what_is_compiled_first_comes_first(monkeypatch):
    monkeypatch.setattr(ahead.threads, "cores", lambda: 8)
    done, slow = [], threading.Event()
    with ahead.compiling() as pool:
        first, second = pool.submit(slow.wait, 60), pool.submit(lambda: True)

        def finish():
            done.append("second")
            slow.set()

        ahead.carry_out(
            [
                ahead.Task("first", first, frozenset(), lambda: done.append("first")),
                ahead.Task("second", second, frozenset(), finish),
            ]
        )
    assert done == ["second", "first"]


def test_a_program_that_cannot_be_compiled_fails_where_it_is_asked_for(monkeypatch):
    monkeypatch.setattr(ahead.threads, "cores", lambda: 8)
    with ahead.compiling() as pool:
        broken = pool.submit(lambda: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            ahead.carry_out([ahead.Task("broken", broken, frozenset(), broken.result)])


def test_a_task_that_can_never_come_is_named():
    tasks = [ahead.Task("a", None, frozenset("b"), lambda: None)]
    with pytest.raises(ValueError, match=r"'a' needs what never comes: frozenset\(\{'b'\}\)"):
        ahead.carry_out(tasks)


def test_an_error_loses_what_needs_the_task_and_nothing_else():
    done, failed = [], []

    def task(name, *needs):
        do = lambda: done.append(name) if name != "b" else 1 // 0  # noqa: E731
        return ahead.Task(name, None, frozenset(needs), do, name.upper())

    tasks = [task("d", "c"), task("c", "b"), task("b"), task("a")]
    ahead.carry_out(tasks, lambda task, error: failed.append((task.about, type(error))))
    assert (done, failed) == (["a"], [("B", ZeroDivisionError)])


def test_a_task_that_bears_it_goes_on_with_what_is_left_of_its_needs():
    done, failed = [], []

    def task(name, *needs):
        do = lambda: done.append(name) if name not in "bc" else 1 // 0  # noqa: E731
        return ahead.Task(name, None, frozenset(needs), do, bears=bool(needs))

    tasks = [task("e", "b", "c"), task("d", "a", "b"), task("c"), task("b"), task("a")]
    ahead.carry_out(tasks, lambda task, error: failed.append(task.name))
    assert (done, failed) == (["a", "d"], ["c", "b"])
