"""Success rates say what they count: a number of starts, or success from the only one."""

import math
import re

import pytest

from gril_jax.errors import RunError
from gril_jax.report.rates import Rate, own_start, rates, sentences, wilson


@pytest.mark.parametrize("count", [1, 7, 50, 1000])
@pytest.mark.parametrize("rate", [0.0, 0.3, 1.0])
def test_wilsons_bounds_are_where_the_rate_is_just_not_refuted(rate, count):
    """Each bound p solves |rate - p| = z sqrt(p (1 - p) / count), the score test's edge."""
    for bound, edge in zip(wilson(rate, count), (0.0, 1.0), strict=True):
        if bound == pytest.approx(edge, abs=1e-12):
            assert rate == edge
            continue
        spread = math.sqrt(bound * (1 - bound) / count)
        assert abs(rate - bound) == pytest.approx(1.959963984540054 * spread, rel=1e-9)


def test_wilsons_interval_mirrors_and_narrows():
    low, high = wilson(0.2, 30)
    assert wilson(0.8, 30) == pytest.approx((1 - high, 1 - low))
    narrow = wilson(0.2, 3000)
    assert low < narrow[0] < 0.2 < narrow[1] < high


@pytest.mark.parametrize(
    ("rate", "words"),
    [
        (Rate(0.5, 20), "50.0% of 20 starts (95% interval 29.9% to 70.1%)"),
        (Rate(0.9, 20, 20, True, "jitter"), "90.0% of 20 Jitter starts (95% interval"),
        (Rate(1.0, 1, 100, variant="demo"), "success (one Demo start)"),
        (Rate(0.0, 1, 100), "no success (one start)"),
        (Rate(0.5, 1, 100), "no success (one start)"),
        (Rate(0.93, 1, 100, True, "demo"), "93.0% of 100 sampled episodes from one Demo start"),
        (Rate(0.93, 1, 0, True), "93.0% of sampled episodes from one start"),
    ],
)
def test_a_rate_in_words(rate, words):
    assert str(rate).startswith(words)
    if rate.starts == 1:
        assert str(rate) == words


def test_the_interval_is_over_starts_and_not_over_episodes():
    assert Rate(0.5, 4, 400, True).interval == wilson(0.5, 4)
    assert Rate(0.5, 1, 400, True).interval is None
    assert Rate(0.5, 4, 400, True).tally == "2 of 4 starts"
    assert Rate(0.3, 4, 400, True).tally == "30.0% of 4 starts"


def test_no_sentence_has_a_percentage_without_what_it_counts():
    results = {"success": 0.9, "success_sampled": 0.8, "success_random": 0.0, "eval_episodes": 8}
    own = {"starts": 8, "variant": "jitter", "demo_solved": False}
    other = {"elsewhere_success": 0.25, "elsewhere_starts": 8, "elsewhere_variant": "layout"}
    for known in (own, own | other, {"starts": 1}):
        lines = sentences(results | known)
        assert len(lines) >= 3
        for line in lines:
            assert re.search(r"success|\d start|\d \w+ start|one start", line)
    assert sentences(results | own)[-1] == "the task's own start: no success"
    assert sentences({}) == []


@pytest.mark.parametrize(
    ("results", "message"),
    [
        ({"success": 7}, "success is 7"),
        ({"success": 1, "starts": "many"}, "starts must be"),
        ({"success": 1}, "starts is missing"),
    ],
)
def test_what_is_no_rate_is_refused(results, message):
    with pytest.raises(RunError, match=message):
        rates(results)
    with pytest.raises(RunError, match="demo_solved must be true or false"):
        own_start({"demo_solved": "yes"})
