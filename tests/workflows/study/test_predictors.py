"""Correlations of measures with success, beside SciPy's, and what is left out."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from gril_jax.workflows.study.predictors import correlations, figure, part


def _lines(**columns):
    return [
        {"row": "a", "seed": i} | dict(zip(columns, x, strict=True))
        for i, x in enumerate(zip(*columns.values(), strict=True))
    ]


def _measured(count=30):
    """Success that goes with the hack gap, against misranked successes, and not with tau."""
    rng = np.random.default_rng(0)
    success = np.round(rng.random(count), 1)  # with ties
    return dict(
        success=success.tolist(),
        hack_gap_demo=(success + 0.3 * rng.random(count)).tolist(),
        misranked_demo=(-success + 0.5 * rng.random(count)).tolist(),
        tau=rng.random(count).tolist(),
    )


def test_correlations_are_spearmans_with_the_better_end_up():
    columns = _measured()
    found = {x.measure: x for x in correlations(_lines(**columns), success="success")}
    assert next(iter(found)) == "hack gap, demo"  # the highest first
    for name, said, sign in [
        ("hack_gap_demo", "hack gap, demo", 1), ("misranked_demo", "misranked, demo", -1),
        ("tau", "alignment tau", 1),
    ]:  # fmt: skip
        expected = sign * spearmanr(columns[name], columns["success"]).statistic
        one = found[said]
        assert one.value == pytest.approx(expected, abs=1e-12)
        assert -1 <= one.low <= one.value <= one.high <= 1
        assert one.policies == 30
    assert found["hack gap, demo"].low > 0.5
    assert found["alignment tau"].low < 0 < found["alignment tau"].high


def test_order_alone_counts():
    """A measure and its cube have the same correlation, and the same interval."""
    columns = _measured()
    columns["tau"] = (np.array(columns["hack_gap_demo"]) ** 3).tolist()
    found = {x.measure: x[1:] for x in correlations(_lines(**columns), success="success")}
    assert found["alignment tau"] == pytest.approx(found["hack gap, demo"], abs=1e-12)


def test_what_is_constant_or_known_of_few_is_left_out():
    columns = _measured()
    columns |= {"kept_demo": [1.0] * 30, "order_demo": [0.5, None] * 4 + [float("nan")] * 22}
    columns["misranked_nothing_done_demo"] = columns["tau"]  # a part of another measure
    names = [x.measure for x in correlations(_lines(**columns), success="success")]
    assert sorted(names) == ["alignment tau", "hack gap, demo", "misranked, demo"]
    assert correlations(_lines(**columns | {"success": [1.0] * 30}), success="success") == []
    assert correlations(_lines(**_measured(9)), success="success") == []
    assert correlations([], success="success") == []


def test_a_section_and_a_figure_have_a_line_for_each_measure():
    known = correlations(_lines(**_measured()), success="success")
    shown = part(known)
    assert [*shown.cells] == [x.measure for x in known]
    one = known[0]
    text = f"{one.value:.2f} ({one.low:.2f} to {one.high:.2f})"
    assert shown.cells[one.measure] == [text, "30"]
    (axes,) = figure(known).axes
    assert [x.get_text() for x in axes.get_yticklabels()] == [x.measure for x in known]
