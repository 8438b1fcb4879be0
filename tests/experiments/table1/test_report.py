"""Table I's page from the files of a run: the same page, or a sentence about what is missing."""

import re

import pytest
from gril_jax.experiments.table1 import report as table1_report
from gril_jax.experiments.table1 import results as table1_results
from gril_jax.experiments.table1.rows import Settings, write_settings
from gril_jax.experiments.table1.scores import SCORES

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import run_dir

ROWS = {"environmental": {}, "ours audited": {}}
WRITTEN = ("table1.md", "table1.csv", "figure2.png", "report.html")


@pytest.fixture
def run(tmp_path):
    """A run of two rows, of which one has finished."""
    path = tmp_path / "run"
    opened = {"device": "a test", "command": ["gril", "table1"], "experiment": "table1"}
    with run_dir.create(path, RunConfig(), **opened) as made:
        write_settings(path, Settings(rows=ROWS, seeds=2))
        made.finish_phase("demos", {"sha256": "abc"})
        for steps in (10, 20):
            values = {name: [0.25, 0.75] for name in SCORES}
            made.log(phase="policy-0", env_steps=steps, seconds=steps, **values)
        made.finish_phase("policy-0", {"rows": [[0, 0], [0, 1]], "taus": [None, None]})
    return path


def _files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_page_is_the_one_that_the_run_wrote(run):
    table1_results.write(run, table1_results.read(run))
    before = _files(run)
    for name in WRITTEN:
        (run / name).unlink()
    said = []
    assert table1_report.main(run, echo=said.append) == run / "report.html"
    assert _files(run) == before
    assert said == [f"report: {run / 'report.html'}"]
    assert "environmental" in (run / "report.html").read_text()


@pytest.mark.parametrize("name", ["config.yaml", "table1.json", "phases.json", "versions.json"])
def test_a_damaged_file_is_one_sentence_and_the_page_stays(run, name):
    (run / "report.html").write_text("the page")
    (run / name).write_bytes((run / name).read_bytes()[:-9] + b"[")
    before = _files(run)
    with pytest.raises(RunError, match=re.escape(name)) as error:
        table1_report.main(run)
    assert "\n" not in str(error.value)
    assert _files(run) == before


def test_a_run_that_has_only_begun_has_no_table_yet(tmp_path):
    begun = tmp_path / "begun"
    run_dir.create(begun, RunConfig(), device="a test", experiment="table1").close()
    write_settings(begun, Settings(rows=ROWS, seeds=2))
    with pytest.raises(RunError, match="has no policy that has finished, so its table is still"):
        table1_report.main(begun)
    assert not (begun / "report.html").exists()
