"""Every verb that prints a success rate says beside it how many starts it counts."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.run_folders import RESULTS, save_run

from gril_jax.config import RunConfig
from gril_jax.report import rates
from gril_jax.report.curves import spread
from gril_jax.report.run_report import write_report
from gril_jax.report.style import png
from gril_jax.workflows.study import recipe, summary
from gril_jax.workflows.study.programs import Counted
from gril_jax.workflows.study.results import Curve, Found
from gril_jax.workflows.study.saved import Plan

COUNTED = {"demo": Counted(4, 1), "jitter": Counted(4, 4), "layout": Counted(4, 4)}
SAYS = r"\d (\w+ )?starts?\b|one (\w+ )?start\b|starts not recorded|solved"
RATE = r"\d ?%|success, (deterministic|sampled) actions"
# Levels of intervals, of success that is waited for, and shares of what is no episode.
LEVELS = r"9\d ?% (interval|bootstrap|Wilson)|to \d\d %|of at least 80 %"
NO_RATE = rf"{LEVELS}|\d+ % \||in \d+ % of the samples"
END = r"\n\n|</div>|</figure>|\n(?!\||<t|</t)"


def unsaid(text):
    """Pieces of a text with a success rate that do not say what it counts."""
    pieces = [re.sub(NO_RATE, "", piece) for piece in re.split(END, text)]
    return [x for x in pieces if re.search(RATE, x) and not re.search(SAYS, x)]


def _found(counted):
    """Two policies of a study that measures all it can."""
    draw = np.random.default_rng(0)
    suffixes = ["", *(f"_{variant}" for variant in [*counted][1:])]
    names = [f"{x}{s}{a}" for x in ("success", "score") for s in suffixes for a in ("", "_sampled")]
    names += ["success_ever", "env_steps", "steps_80", "tau", "order_demo", "played_success_all"]
    lines = [
        {"row": "a row", "seed": seed} | {name: float(draw.uniform()) for name in names}
        for seed in (0, 1)
    ]
    for line in lines:
        for one in [*counted.values()][:1]:
            line |= {"starts": one.distinct, "episodes": one.episodes, "played_starts": 64}
    scores = {f"success{suffix}_sampled": np.ones(1) for suffix in suffixes}
    curve = Curve(0, 0, None, np.ones(1), scores, counted)
    plan = Plan(recipe.Study("mine"), RunConfig(), {"a row": RunConfig()}, {"a row": [0, 1]})
    return Found(plan, lines, [curve], {}, {}, {"command": "gril"})


def _study_page(found):
    return _body(summary.page(found, png(spread({"a": np.zeros(1)}, "x")), Path("nowhere")))


def _body(page):
    return re.sub('data:[^"]*', "", page[page.index("<body") :])


def _report(folder, results):
    return write_report(save_run(folder / "run", results=results)).read_text(encoding="utf-8")


TABLES = {"study": summary.text, "report of study": _study_page}


@pytest.mark.parametrize("starts", [COUNTED, {"layout": Counted(4, 4)}, {}])
@pytest.mark.parametrize("write", TABLES.values(), ids=TABLES)
def test_a_study_says_what_its_success_counts(write, starts):
    text = write(_found(starts))
    assert re.search(RATE, text)
    assert unsaid(text) == []
    if not starts:
        assert "number of starts not recorded" in text


def test_of_a_single_start_a_study_says_who_solves_it():
    found = _found({"demo": Counted(1, 1)})
    for line, success in zip(found.lines, (1.0, 0.0), strict=True):
        line["success"] = success
    assert "1 of 2 policies succeed" in summary.text(found)


@pytest.mark.parametrize("results", [RESULTS, RESULTS | {"starts": 1, "success": 1.0}])
def test_train_and_eval_and_report_say_what_they_count(results, tmp_path):
    lines = rates.sentences(results)  # what `gril train` and `gril eval` print
    assert len(lines) >= 3
    assert [x for line in lines for x in unsaid(line)] == []
    page = _report(tmp_path, results)
    top = page[page.index('class="verdict') : page.index("What was run")]
    assert re.search(RATE, top)
    assert unsaid(re.sub("<[^/].*?>", " ", re.sub('data:[^"]*', "", top))) == []


def test_a_rate_that_counts_one_episode_many_times_is_found():
    assert unsaid("success 100.0% over 100 episodes (random policy 0.0%)")
    assert unsaid("| | success, sampled actions |\n|---|---|\n| a | 0.5 |")
    assert not unsaid("solved (one Demo start)")
    assert not unsaid("95% interval")
