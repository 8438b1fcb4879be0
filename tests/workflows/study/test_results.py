"""The results of a study: read from the files of its run and parts, told, and drawn again."""

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.workflows.study import parts, recipe, results, saved, summary
from gril_jax.workflows.study.programs import Counted
from gril_jax.workflows.study.recipe import changed
from gril_jax.workflows.study.results import Curve, curves, first_at, in_last_tenth, numbers
from gril_jax.workflows.study.saved import Plan

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
AUDIT = {"order": 0.99, "touch": 0.01, "push": 0.5, "hack_gap": 0.1, "misranked": 0.0,
         "kept": 1.0}  # fmt: skip


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


def test_a_seed_that_diverged_is_left_out_and_the_others_of_its_row_stay(tmp_path):
    with _begun(tmp_path / "run", {"own": (0, 1, 2)}) as made:
        _policies(made, 0, (0, 1, 2))
        done = made.finished_phase("policy-0") | {"diverged": {"1": "its loss is not finite"}}
        made.finish_phase("policy-0", done)
        numbers = {"played_score": [0.5, 0.0, 0.7]}
        made.finish_phase("variants-policy-0", {"rows": done["rows"], "numbers": numbers})
    found = results.read(tmp_path / "run")
    assert [line["seed"] for line in found.lines] == [0, 2]
    assert [line["played_score"] for line in found.lines] == [0.5, 0.7]
    assert [curve.seed for curve in found.curves] == [0, 2]


def test_of_two_tries_of_a_program_the_later_one_counts(tmp_path):
    with _begun(tmp_path / "run", {"own": (0, 1)}) as made:
        for actions, seeds in (("", (4, 4)), ("_sampled", (4, 4))):  # of a try that failed
            made.log(phase="policy-0", env_steps=10, **{f"success{actions}": [*seeds]})
        made.log(phase="policy-1", env_steps=10, success_sampled=[0.0])
        _policies(made, 0, (0, 1))
    curves = results.read(tmp_path / "run").curves
    assert [list(x.env_steps) for x in curves] == [[10, 20]] * 2
    assert [list(x.scores["success_sampled"]) for x in curves] == [[0.25] * 2, [0.75] * 2]


def test_policies_that_were_played_but_not_noted_yet_are_left_out(tmp_path):
    with _begun(tmp_path / "run", {"own": (0, 1)}) as made:
        numbers = {"played_score": [0.5, 0.7]}
        rows = {"rows": [[0, 0], [0, 1]], "numbers": numbers}
        made.finish_phase("variants-policy-0", rows)
    assert not results.read(tmp_path / "run").curves


def test_a_row_that_succeeds_in_a_later_try_has_not_failed(tmp_path):
    with _begun(tmp_path / "run", {"own": (0, 1)}, in_parts=True) as made:
        made.finish_phase("failed", {"0": "no memory"})
    (tmp_path / "run" / "parts").mkdir()
    with _begun(tmp_path / "run" / "parts" / "000", {"own": (0, 1)}) as part:
        part.finish_phase("failed", {"0": "no memory"})
        assert parts._failed(tmp_path / "run", {}) == {0: "no memory"}
        part.finish_phase("failed", {})
        _policies(part, 0, (0, 1))
        assert parts._failed(tmp_path / "run", {}) == {}
        part.finish_phase("failed", {"0": "its audit found no memory"})
        assert parts._failed(tmp_path / "run", {}) == {0: "its audit found no memory"}


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
    assert found.csv.startswith("row,seed,success,")
    assert own["published success_jitter"] == "85.0"
    known = list(csv.DictReader(found.csv.splitlines()))
    assert [line["order_demo"] for line in known] == ["", "", "0.99", ""]


def test_the_table_has_a_section_for_whatever_was_measured(run):
    text = summary.text(results.read(run))
    assert "| own | 85.0 | " not in text  # policies come first
    row = next(line for line in text.splitlines() if line.startswith("| own |"))
    assert row.startswith("| own | 2 | 85.0 | 50.0; 50.0 (")
    for words in (
        "4 Jitter starts",
        "one Demo start",
        "0 of 2 policies succeed",
        "1 of 1",
        "Assistance: ",
    ):
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
    assert str(found.lines[:3]) == str(whole.lines[:3])
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


# --- policies

SCORES = ("success", "success_sampled", "success_ever", "score")
OF, TAUS = [(1, 0), (0, 0), (0, 1)], [0.9, None, 0.8]


@pytest.fixture(scope="module")
def lines():
    """Lines of metrics.jsonl of two programs."""
    draw = np.random.default_rng(0)
    return [
        {"phase": phase, "env_steps": 100 * (k + 1)}
        | {name: draw.uniform(size=3).tolist() for name in SCORES}
        for k in range(20)
        for phase in ("policy-0", "policy-1")
    ]


def _found(lines, scores=None):
    lines = [line | (scores or {}) for line in lines]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results.run_dir, "read_metrics", lambda folder: lines)
        return curves(Path(), {"policy-0": {"rows": OF, "taus": TAUS}, "demos": {}})


def test_a_policy_s_curve_is_its_column_of_its_program_s_metrics(lines):
    found, own = _found(lines), [line for line in lines if line["phase"] == "policy-0"]
    assert [(curve.cell, curve.seed, curve.tau) for curve in found] == [
        (0, 0, None),
        (0, 1, 0.8),
        (1, 0, 0.9),
    ]
    for i, curve in zip((1, 2, 0), found, strict=True):
        np.testing.assert_array_equal(curve.env_steps, [line["env_steps"] for line in own])
        assert {*curve.scores} == {*SCORES}
        for name in SCORES:
            np.testing.assert_array_equal(curve.scores[name], [line[name][i] for line in own])


def test_a_number_that_was_not_finite_is_told_as_such(lines):
    """metrics.jsonl holds null in its place."""
    found = _found(lines, {"score": [None, 0.5, 0.5]})
    assert np.isnan(numbers(found[2])["score"])


def test_a_policy_s_numbers_are_means_over_the_last_tenth_and_the_first_with_80_percent(lines):
    last = [line for line in lines if line["phase"] == "policy-0"][-2:]
    for i, curve in zip((1, 2, 0), _found(lines), strict=True):
        found = numbers(curve)
        assert found["env_steps"] == 2000
        for name in SCORES:
            assert found[name] == pytest.approx(np.mean([line[name][i] for line in last]))
        reached = curve.env_steps[curve.scores["success_sampled"] >= 0.8]
        assert found["steps_80"] == reached[0]


def test_the_first_variant_with_several_starts_tells_most(lines):
    curve, *_ = _found(lines)
    own, many = Counted(4, 1), Counted(4, 4)
    for starts, suffix in (
        ({"demo": own, "jitter": many, "layout": many}, "_jitter"),
        ({"jitter": many, "layout": many}, ""),
        ({"demo": own}, ""),
    ):
        assert dataclasses.replace(curve, starts=starts).headline == suffix


def test_what_success_counts_is_that_of_all_policies():
    def said(*distinct, variant="", sampled=False):
        starts = [{} if x is None else {variant: Counted(8, x)} for x in distinct]
        found = [Curve(0, k, None, np.ones(1), {}, one) for k, one in enumerate(starts)]
        plan = Plan(STUDY, RunConfig(), {}, {})
        return results.Found(plan, [], found, {}, {}, {}).counted(variant, sampled=sampled)

    assert said(8, 8) == "8 starts"
    assert said(8, 16) == "8 to 16 starts"
    assert said(8, None) == said() == "number of starts not recorded"
    assert said(1, variant="demo") == "one Demo start"
    assert said(1, variant="demo", sampled=True) == "8 sampled episodes from one Demo start"


def test_a_level_is_reached_at_the_first_evaluation_at_or_above_it():
    success, at = np.array([0.1, 0.8, 0.2, 0.9]), np.array([10.0, 20.0, 30.0, 40.0])
    assert first_at(success, at, level=0.8) == 20.0  # reached exactly, and lost again later
    assert first_at(success, at, level=0.85) == 40.0
    assert first_at(success, at, level=0.05) == 10.0  # at once
    assert np.isnan(first_at(success, at, level=0.95))  # never
    assert first_at(np.array([np.float32(0.8)]).astype(float), at[:1], level=0.8) == 10.0


@pytest.mark.parametrize(("evaluations", "last"), [(1, 1), (4, 1), (10, 1), (11, 2), (20, 2)])
def test_the_last_tenth_has_the_evaluations_after_nine_tenths(evaluations, last):
    chosen = in_last_tenth(np.arange(1, evaluations + 1) * 30.0)
    np.testing.assert_array_equal(chosen, np.arange(evaluations) >= evaluations - last)
