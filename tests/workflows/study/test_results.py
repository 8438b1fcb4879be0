"""The results of a run: read from its files, and drawn again."""

import re

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.workflows.study import results
from gril_jax.workflows.study.rows import write_settings
from gril_jax.workflows.study.soundness.soundness import TABLE as SOUNDNESS
from gril_jax.workflows.study.table1.columns import COLUMNS
from gril_jax.workflows.study.table1.rows import Settings
from gril_jax.workflows.study.table1.table1 import TABLE

ROWS = {"environmental": {}, "ours audited": {}}
WRITTEN = ("table1.md", "table1.csv", "figure2.png", "report.html")


@pytest.fixture
def run(tmp_path):
    """A run of two rows, of which one has finished."""
    path = tmp_path / "run"
    opened = {"device": "a test", "command": ["gril", "table1"], "experiment": "table1"}
    with run_dir.create(path, RunConfig(), **opened) as made:
        write_settings(path, "table1", Settings(rows=ROWS, seeds=2))
        made.finish_phase("demos", {"sha256": "abc"})
        for steps in (10, 20):
            values = {name: [0.25, 0.75] for name in COLUMNS[2:14]}
            made.log(phase="policy-0", env_steps=steps, seconds=steps, **values)
        made.finish_phase("policy-0", {"rows": [[0, 0], [0, 1]], "taus": [None, None]})
    return path


def _files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_page_is_the_one_that_the_run_wrote(run):
    found = results.read(TABLE, run, Settings(rows=ROWS))
    results.write(TABLE, run, found)
    before = _files(run)
    for name in WRITTEN:
        (run / name).unlink()
    results.write(TABLE, run, found, last=False)
    assert not (run / "report.html").exists()
    said = []
    results.redraw(TABLE, run, echo=said.append)
    assert _files(run) == before
    assert said == [f"report: {run / 'report.html'}"]
    assert "environmental" in (run / "report.html").read_text()


@pytest.mark.parametrize("name", ["config.yaml", "table1.json", "phases.json", "versions.json"])
def test_a_damaged_file_is_one_sentence_and_the_page_stays(run, name):
    (run / "report.html").write_text("the page")
    (run / name).write_bytes((run / name).read_bytes()[:-9] + b"[")
    before = _files(run)
    with pytest.raises(RunError, match=re.escape(name)) as error:
        results.redraw(TABLE, run)
    assert "\n" not in str(error.value)
    assert _files(run) == before


def test_a_run_that_has_only_begun_has_no_table_yet(tmp_path):
    begun = tmp_path / "begun"
    run_dir.create(begun, RunConfig(), device="a test", experiment="table1").close()
    write_settings(begun, "table1", Settings(rows=ROWS, seeds=2))
    with pytest.raises(RunError, match="has no policy that has finished, so its table is still"):
        results.redraw(TABLE, begun)
    assert not (begun / "report.html").exists()


def test_a_line_has_what_was_measured_of_its_seed_and_what_was_not_finite_is_missing(run):
    with run_dir.resume(run) as made:
        made.finish_phase("tau-1", {"tau": [0.5, 0.75]})
        made.finish_phase("audit-1", {"order_demo": [0.25, None], "stray": [1, 2]})
        made.finish_phase("measures-1", {"seeds": [{"auc one shoe": 1.0}, {"order": None}]})
    first, second, third, fourth = results.read(SOUNDNESS, run, Settings(rows=ROWS)).lines
    assert [(x["row"], x["seed"]) for x in (first, fourth)] == [
        ("environmental", 0),
        ("ours audited", 1),
    ]
    assert (first["success"], second["success_sampled"]) == (0.25, 0.75)
    assert third == {"row": "ours audited", "seed": 0, "tau": 0.5, "order_demo": 0.25}
    assert fourth == {"row": "ours audited", "seed": 1, "tau": 0.75}
    each = SOUNDNESS._replace(measured={"measures": ()})
    lines = results.read(each, run, Settings(rows=ROWS)).lines[2:]
    assert lines[0] == {"row": "ours audited", "seed": 0, "auc one shoe": 1.0}
    assert lines[1] == {"row": "ours audited", "seed": 1}
