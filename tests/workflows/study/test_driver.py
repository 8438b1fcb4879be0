"""Whole studies: one that is cut off and goes on, and one with a row that fails."""

import contextlib
import csv
import io
import types
from dataclasses import replace

import pytest
from support import new_task
from support.tiny_runs import command

from gril_jax import threads
from gril_jax.cli import main
from gril_jax.config import RunConfig
from gril_jax.errors import DemoError
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.workflows.study import audit, driver, saved


@pytest.fixture
def task(tmp_path, monkeypatch):
    new_task.write(tmp_path, new_task.AUDITED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(threads, "cores", lambda: 2)  # things are done in the rows' order
    return tmp_path


def _lines(folder):
    return list(csv.DictReader((folder / "study.csv").open()))


@pytest.mark.slow
def test_a_study_that_was_cut_off_goes_on_where_it_stood(task, monkeypatch):
    out, learn, done = task / "run", driver.learn_policies, []

    def once(*args):
        if done:
            raise KeyboardInterrupt
        done.append(args[0].name)
        return learn(*args)

    with monkeypatch.context() as cut:
        cut.setattr(driver, "learn_policies", once)
        assert main.main([*command("table1")]) == 130
    first = _lines(out)
    assert [x["row"] for x in first if x["success"]] == ["environmental"] * 2
    monkeypatch.setattr(audit, "audit_figures", None)  # not done again
    assert main.main(["sweep", "--resume", str(out)]) == 0
    lines = _lines(out)
    assert [(x["row"], x["seed"]) for x in lines] == [
        (row, seed) for row in ("environmental", "ours without robot") for seed in "01"
    ]
    for line in lines:
        assert float(line["env_steps"]) == 320
        assert 0 <= float(line["success"]) <= 1
        assert (line["tau"] == "") == (line["order_demo"] == "") == (line["row"] == "environmental")
    results = run_dir.read_results(out)
    assert results == {"rewards": 2, "policies": 4, "programs": 2}
    for name in ("study.md", "study.png", "report.html"):
        assert (out / name).stat().st_size > 500


def test_a_row_that_fails_ends_neither_the_others_nor_the_study(task, monkeypatch, capsys):
    out, learn = task / "run", driver.learn_policies

    def broken(program, *args):
        if program.rows[0].config.run.reward == "learned":
            raise RuntimeError("RESOURCE_EXHAUSTED: out of memory\nat line 3")
        return learn(program, *args)

    with monkeypatch.context() as cut:
        cut.setattr(driver, "learn_policies", broken)
        assert main.main([*command("sweep")]) == 1
    said = capsys.readouterr().out
    row = "reward learned"
    assert f"the row {row!r} failed: RuntimeError: RESOURCE_EXHAUSTED: out of memory" in said
    assert "(alone: gril train run/rows/reward-learned.yaml)" in said
    assert {x["row"] for x in _lines(out) if x["success"]} == {"reward environmental"}
    assert "failed: RuntimeError" in (out / "study.md").read_text()
    assert not (out / "results.json").exists()
    assert main.main(["sweep", "--resume", str(out)]) == 0  # it is tried again
    assert all(x["success"] for x in _lines(out))
    assert "failed" not in (out / "study.md").read_text()
    assert main.main(["sweep", "--resume", str(out)]) == 2  # it has finished


@pytest.mark.slow
def test_a_reward_that_cannot_be_learned_fails_its_rows_alone(task, monkeypatch, capsys):
    def broken(*args):
        raise ValueError("no encoder")

    monkeypatch.setattr(driver.study_rewards, "learn", broken)
    assert main.main([*command("sweep")]) == 1
    assert "the row 'reward learned' failed: ValueError: no encoder" in capsys.readouterr().out
    assert {x["row"] for x in _lines(task / "run")} == {"reward environmental"}


def test_counts_are_said_in_the_singular_and_the_plural():
    counts = {"rewards": 1, "policies": 1, "programs": 2, "rows": 0}
    assert driver.in_words(counts) == "1 reward, 1 policy, 2 programs"
    assert driver.in_words({"policies": 3}) == "3 policies"


def test_folders_of_demonstrations_are_those_of_the_rows_whichever_is_made_first(
    tmp_path, monkeypatch
):
    """A set that cannot be made leaves its folder to itself, and so does a run that goes on."""
    sizes = {"own": 20, "other": 8, "third": 40}
    plain = RunConfig()
    rows = [
        saved.Row(cell, 0, replace(plain, demos=replace(plain.demos, num=num)))
        for cell, num in enumerate(sizes.values())
    ]

    def made(config, env, folder, *_):
        if config.demos.num == 8:
            raise DemoError("8 are too few")
        named = folder.path / "demos" if isinstance(folder, run_dir.RunDir) else folder
        return driver.Demonstrations(types.SimpleNamespace(where=named.name), {}, 0)

    monkeypatch.setattr(driver.demonstrations, "gather_once", made)
    monkeypatch.setattr(driver.demonstrations, "gather", made)
    monkeypatch.setattr(driver.reading, "require_unchanged", lambda *_: None)
    monkeypatch.setattr(driver.setup, "make_env", lambda *_, **__: None)
    opened = {"device": "cpu", "experiment": "sweep"}
    with (
        run_dir.create(tmp_path / "run", plain, **opened) as run,
        Progress(stream=io.StringIO()) as progress,
    ):
        monkeypatch.setattr(run, "cover", lambda *_: None)
        for order in ([0, 1, 2], [2, 1, 0]):
            gather = driver._gatherer(plain, rows, run, progress)
            found = {}
            for at in order:
                with contextlib.suppress(DemoError):
                    found[at] = gather(rows[at].config).demo_set.where
            assert found == {0: "demos", 2: "demos-2"}
