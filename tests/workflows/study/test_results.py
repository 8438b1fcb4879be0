"""The results of a study: read from the files of its run and parts, told, and drawn again."""

import re

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.workflows.study import recipe, results, saved, summary
from gril_jax.workflows.study.rows import changed
from gril_jax.workflows.study.saved import Plan
from gril_jax.workflows.study.written import csv

STUDY = recipe.Study(
    "mine", seeds=2, measure={"audit": {"variants": ["demo"]}, "profiles": {}},
    published={"success_jitter": {"own": 85.0}},
)  # fmt: skip
ROWS = {
    "own": changed(RunConfig(), {"run.reward": "environmental"}),
    "ours": RunConfig(),
    "never": changed(RunConfig(), {"pool.alpha": 2}),
}
STARTS = {
    "demo": {"episodes": 4, "distinct": 1},
    "jitter": {"episodes": 4, "distinct": 4},
}
AUDIT = {"order": 0.99, "touch": 0.01, "push": 0.5, "hack_gap": 0.1, "outbid": 0.0}


def _begun(path, work, *, in_parts=False):
    known = {"device": "a test", "command": ["gril", "sweep"], "experiment": saved.EXPERIMENT}
    run = run_dir.create(path, RunConfig(), **known)
    run.cover("begun", saved.write(path, Plan(STUDY, RunConfig(), ROWS, work, in_parts)))
    return run


def _policies(run, cell, seeds):
    """Finishes a program with the policies of a row."""
    for steps in (10, 20):
        values = {
            f"{name}{start}{actions}": [0.25 * (cell + 1) + 0.5 * seed for seed in seeds]
            for name in ("success", "success_ever", "score")
            for start in ("", "_jitter")
            for actions in ("", "_sampled")
        }
        run.log(phase="policy-0", env_steps=steps, seconds=steps, **values)
    taus = [None if cell == 0 else 0.5] * len(seeds)
    rows = [[cell, seed] for seed in seeds]
    run.finish_phase("policy-0", {"rows": rows, "taus": taus, "starts": STARTS})


def _rewards(run, seeds):
    audit = {f"{name}_demo": [x, *[None] * (len(seeds) - 1)] for name, x in AUDIT.items()}
    run.finish_phase("audit-1", audit)
    traces = {"success": [[-1.0, 0.0]], "failure": [[-1.0, -0.9]]}
    run.finish_phase("profiles-1", {"cycle": [0.8] * len(seeds), **traces})


@pytest.fixture
def run(tmp_path):
    """A run whose first row has finished; the second has been measured alone."""
    with _begun(tmp_path / "run", {"own": (0, 1), "ours": (0, 1)}) as made:
        _policies(made, 0, (0, 1))
        _rewards(made, (0, 1))
    return tmp_path / "run"


def _files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_line_has_what_was_measured_of_its_seed_and_what_was_not_finite_is_missing(run):
    found = results.read(run)
    assert [(x["row"], x["seed"]) for x in found.lines] == [
        ("own", 0), ("own", 1), ("ours", 0), ("ours", 1),
    ]  # fmt: skip
    own, _, ours, other = found.lines
    assert (own["success_jitter"], own["steps_80"] == own["steps_80"]) == (0.25, False)
    assert "tau" not in own
    assert (ours["order_demo"], ours["cycle"], ours["passes"]) == (0.99, 0.8, 1.0)
    assert "order_demo" not in other
    assert found.columns[:3] == ["row", "seed", "success"]
    text = csv(found.lines, found.columns)
    assert text.splitlines()[0].endswith(",outbid_demo,passes")


def test_the_table_has_a_section_for_whatever_was_measured(run):
    text = summary.text(results.read(run))
    assert "| own | 85.0 | " not in text  # policies come first
    row = next(line for line in text.splitlines() if line.startswith("| own |"))
    assert row.startswith("| own | 2 | 85.0 | 50.0; 50.0 (")
    for words in ("4 Jitter starts", "one Demo start", "solved by 0 of 2", "1 of 1", "Given at"):
        assert words in text
    assert "rho" not in text
    assert "never" not in {line.split("|")[1].strip() for line in text.splitlines() if "|" in line}


def test_the_page_is_the_one_that_the_run_wrote(run):
    summary.write(run)
    before = _files(run)
    for name in summary.NAMES:
        (run / name).unlink()
    summary.write(run, last=False)
    assert not (run / "report.html").exists()
    said = []
    summary.redraw(run, echo=said.append)
    assert _files(run) == before
    assert said == [f"report: {run / 'report.html'}"]
    page = (run / "report.html").read_text()
    assert "own" in page
    assert page.count("<img") == 2  # of the curves, and of profiles
    assert "http" not in page.replace("http-equiv", "")


def test_what_failed_is_told_with_the_command_that_runs_it_alone(run):
    with run_dir.resume(run) as made:
        made.finish_phase("failed", {"1": "XlaRuntimeError: no room"})
    found = results.read(run)
    assert found.failed == {"ours": "XlaRuntimeError: no room"}
    assert "The row 'ours' failed: XlaRuntimeError: no room." in summary.text(found)
    page = summary.page(found, b"", run)
    assert "gril train RUN/rows/ours.yaml" in page
    assert "1 failed" in page


def test_parts_are_joined_by_row_and_seed(tmp_path, run):
    top = tmp_path / "top"
    _begun(top, {"own": (0, 1), "ours": (0, 1)}, in_parts=True).close()
    with _begun(top / "parts" / "000", {"own": (0, 1)}) as made:
        _policies(made, 0, (0, 1))
    with _begun(top / "parts" / "001", {"ours": (0,)}) as made:
        _rewards(made, (0,))
    with _begun(top / "parts" / "002", {"ours": (1,), "never": (0,)}) as made:
        _policies(made, 1, (1,))
    whole, found = results.read(run), results.read(top)
    columns = whole.columns
    assert csv(found.lines[:3], columns) == csv(whole.lines[:3], columns)
    assert found.lines[3]["success"] == 1.0
    assert [(c.cell, c.seed) for c in found.curves] == [(0, 0), (0, 1), (1, 1)]
    assert found.plan.work == {"own": [0, 1], "ours": [0, 1], "never": [0]}
    assert found.profiles["ours"]["success"] == whole.profiles["ours"]["success"]


@pytest.mark.parametrize("name", ["config.yaml", "study.json", "phases.json", "versions.json"])
def test_a_damaged_file_is_one_sentence_and_the_page_stays(run, name):
    (run / "report.html").write_text("the page")
    (run / name).write_bytes((run / name).read_bytes()[:-9] + b"[")
    before = _files(run)
    with pytest.raises(RunError, match=re.escape(name)) as error:
        summary.redraw(run)
    assert "\n" not in str(error.value)
    assert _files(run) == before


def test_a_run_that_has_only_begun_has_no_table_yet(tmp_path):
    _begun(tmp_path / "run", {"own": (0,)}).close()
    with pytest.raises(RunError, match="has nothing that has finished"):
        summary.redraw(tmp_path / "run")
    assert not (tmp_path / "run" / "report.html").exists()
