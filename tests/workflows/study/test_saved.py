"""A study in its run's folder, read as it was written."""

import pytest

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.errors import RunError
from gril_jax.runs import reading, run_dir
from gril_jax.workflows.study import recipe, saved
from gril_jax.workflows.study.recipe import changed
from gril_jax.workflows.study.saved import Plan, without_twins


@pytest.fixture
def plan():
    made, base = recipe.load("table1"), load("quickstart")
    rows = {row: changed(base, change) for row, change in made.rows.items()}
    return Plan(made, base, rows, {"environmental": [0, 1], "ours audited": [1]})


@pytest.fixture
def folder(tmp_path, plan):
    path = tmp_path / "run"
    _create(path, lambda new: saved.write(new, plan))
    return path


def _create(path, first):
    told = {"device": "a test", "experiment": saved.EXPERIMENT, "first": first}
    run_dir.create(path, load("quickstart"), **told).close()


def test_a_study_that_is_cut_off_before_all_its_files_are_there_is_no_run(tmp_path, plan):
    """Else it would go on without them, and none of them would have a digest."""

    def cut_off(path):
        saved.write(path, plan)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _create(tmp_path / "run", cut_off)
    with pytest.raises(RunError):
        reading.read_config(tmp_path / "run")


def test_all_files_of_a_study_have_digests(folder):
    known = reading.read_phases(folder).files["begun"]
    assert {"study.json", *(f"rows/{file.name}" for file in (folder / "rows").iterdir())} < {*known}


def test_a_plan_is_read_as_it_was_written(folder, plan):
    found = saved.read(folder)
    assert (found.config, found.rows, found.work) == (plan.config, plan.rows, plan.work)
    assert found.study.measure == plan.study.measure
    assert list(found.study.evaluate) == list(plan.study.evaluate)
    assert [(row.cell, row.seed, row.config.run.seed) for row in found.runs] == [
        (0, 0, 0), (0, 1, 1), (8, 1, 1),
    ]  # fmt: skip


def test_a_row_has_a_file_that_gril_train_takes(folder, plan):
    assert {file.name for file in (folder / "rows").iterdir()} == {
        "environmental.yaml", "ours-audited.yaml",
    }  # fmt: skip
    assert load(str(folder / "rows" / "ours-audited.yaml")) == plan.rows["ours audited"]
    assert saved.command(plan, folder, "ours audited") == (
        f"gril train {folder / 'rows' / 'ours-audited.yaml'}"
    )


def test_rows_with_like_names_have_files_of_their_own(tmp_path):
    found = saved.row_files(tmp_path, ["a b", "a/b", "../a b", "a" * 300, "?"])
    assert len({*found.values()}) == 5
    assert {file.parent for file in found.values()} == {tmp_path / "rows"}
    part = saved.row_files(tmp_path / "parts" / "000", ["a b"])
    assert part["a b"] == found["a b"]  # a part's rows lie in the study's folder


@pytest.mark.parametrize("text", [None, "{", "[]", '{"stray": 1}'])
def test_a_folder_without_a_whole_study_is_refused(folder, text):
    file = folder / "study.json"
    file.unlink() if text is None else file.write_text(text)
    with pytest.raises(RunError, match=r"study\.json"):
        saved.read(folder)


def test_rows_with_the_same_results_are_made_once():
    own, films = {"run.reward": "environmental"}, {"ppo.video_state_resets": 0.5}
    rows = {
        "learned": {}, "learned again": {}, "lambda": {"loss.lambda": 2},
        "own": own, "own with lambda": own | {"loss.lambda": 2},
        "own of a set": own | {"demos.num": 9},
        "from videos": own | films, "from other videos": own | films | {"demos.num": 9},
    }  # fmt: skip
    kept, twins = without_twins({name: changed(RunConfig(), row) for name, row in rows.items()})
    assert twins == {"learned again": "learned", "own with lambda": "own", "own of a set": "own"}
    assert [*kept] == [name for name in rows if name not in twins]
