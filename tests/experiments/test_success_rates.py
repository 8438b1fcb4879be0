"""Every verb that prints a success rate says beside it how many starts it counts."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from support.run_folders import RESULTS, save_run

from gril_jax.report import rates
from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import png
from gril_jax.report.run_report import write_report
from gril_jax.workflows.study.counted import Counted
from gril_jax.workflows.study.curves import Curve
from gril_jax.workflows.study.ladder import ladder
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.soundness import soundness
from gril_jax.workflows.study.suite import suite
from gril_jax.workflows.study.sweeps import sweep
from gril_jax.workflows.study.table1 import columns as table1
from gril_jax.workflows.study.table3 import table3

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


def _found(columns, counted, row="a row"):
    """Lines of two policies, as a run of a table has them."""
    draw = np.random.default_rng(0)
    lines = [
        {"row": row, "seed": seed} | {name: float(draw.uniform()) for name in columns[2:]}
        for seed in (0, 1)
    ]
    first = [*counted.values()][:1]
    for line in lines:
        for name in ("starts", "episodes"):
            line.pop(name, None)
        for one in first:
            line |= {"starts": one.distinct, "episodes": one.episodes}
    curve = Curve(0, 0, None, np.ones(1), np.ones(1), {}, counted)
    return Found([row], lines, [curve], {}, {"command": "gril"})


def _table1_page(found):
    return _body(table1.page(found, png(spread({"a": np.zeros(1)}, "x"))))


def _sweep_page(found):
    return _body(sweep.TABLE.page(found, png(spread({"a": np.zeros(1)}, "x"))))


def _body(page):
    return re.sub('data:[^"]*', "", page[page.index("<body") :])


def _report(folder, results):
    return write_report(save_run(folder / "run", results=results)).read_text(encoding="utf-8")


TABLES = {
    "sweep": (sweep.TABLE.text, sweep.TABLE.columns([])),
    "report of sweep": (_sweep_page, sweep.TABLE.columns([])),
    "soundness": (soundness.TABLE.text, soundness.TABLE.columns([])),
    "ladder": (ladder.TABLE.text, ladder.TABLE.columns([])),
    "table3": (table3.TABLE.text, table3.TABLE.columns([])),
    "suite": (suite.TABLE.text, suite.TABLE.columns([])),
    "table1": (table1.text, table1.COLUMNS),
    "report of table1": (_table1_page, table1.COLUMNS),
}
ROWS = {
    "ladder": "ours at level A", "table3": "ours on umbrella_out", "suite": "make_line from films",
}  # fmt: skip
OLDER = {k: x for k, x in RESULTS.items() if not re.search("starts|variant|elsewhere|solved", k)}


@pytest.mark.parametrize("starts", [COUNTED, {"layout": Counted(4, 4)}, {}])
@pytest.mark.parametrize("verb", TABLES)
def test_a_table_says_what_its_success_counts(verb, starts):
    write, columns = TABLES[verb]
    columns = [name for name in columns if starts or name != "episodes_demo"]  # a suite's own
    text = write(_found(columns, starts, ROWS.get(verb, "a row")))
    assert re.search(RATE, text)
    assert unsaid(text) == []
    if not starts:
        assert "number of starts not recorded" in text


@pytest.mark.parametrize("verb", ["sweep", "soundness", "ladder", "table3"])
def test_of_a_single_start_a_table_says_who_solves_it(verb):
    write, columns = TABLES[verb]
    found = _found(columns, {"demo": Counted(1, 1)}, ROWS.get(verb, "a row"))
    for line, success in zip(found.lines, (1.0, 0.0), strict=True):
        line["success"] = success
    assert "solved by 1 of 2 policies" in write(found)


def test_every_verb_with_policies_is_here():
    """A table that trains policies has a plan for them."""
    names = [path.name for path in Path(tables.__file__).parents[1].iterdir() if path.is_dir()]
    found = set()
    for name in names:
        if importlib.util.find_spec(f"gril_jax.experiments.{name}.{name.removesuffix('s')}"):
            module = importlib.import_module(
                f"gril_jax.experiments.{name}.{name.removesuffix('s')}"
            )
            table = getattr(module, "TABLE", None)
            found |= {table.name} if table and "success" in table.columns([]) else set()
    assert len(found) >= 5
    assert found <= {*TABLES}


@pytest.mark.parametrize("results", [RESULTS, OLDER, RESULTS | {"starts": 1, "success": 1.0}])
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
