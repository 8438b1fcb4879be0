"""Runs with an ordinary report, and runs with a page or table of their own."""

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.report.run_report import write_report
from gril_jax.runs import run_dir
from gril_jax.runs.phases import read_phases, require_single


@pytest.fixture
def run(tmp_path):
    def make(experiment):
        path = tmp_path / "run"
        run_dir.create(path, RunConfig(), device="a test", experiment=experiment).close()
        return path

    return make


@pytest.mark.parametrize("experiment", ["train", "pretrain", None])
def test_a_run_of_one_reward_and_one_policy_has_the_ordinary_page(run, experiment):
    path = run(experiment)
    assert read_phases(path).experiment == experiment
    require_single(path)


@pytest.mark.parametrize(
    ("experiment", "where"),
    [
        ("sweep", "its page is report.html, its table study.md"),
        ("novel", "its results lie there in files of their own"),
    ],
)
def test_a_table_s_run_is_refused_and_nothing_of_it_is_overwritten(run, experiment, where):
    path = run(experiment)
    (path / "report.html").write_text("the table's own page")
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    with pytest.raises(RunError, match=f"holds a run of gril {experiment}, .*{where}") as error:
        write_report(path)
    assert "\n" not in str(error.value)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before


@pytest.mark.parametrize("text", ["", "[", "[1]", "{}", '{"experiment": 3}', "\xff"])
def test_damage_is_one_sentence_that_names_the_file(run, text):
    path = run("train")
    (path / "phases.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(RunError, match=r"phases\.json"):
        require_single(path)
