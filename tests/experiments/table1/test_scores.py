"""What curves of training come to, beside plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.table1.scores import (
    LEVELS,
    SCORES,
    Curve,
    curves,
    in_last_tenth,
    spread,
    summary,
)

from gril_jax.metrics.interquartile import interquartile_interval


def _lines(evaluations=20, policies=3):
    draw = np.random.default_rng(0)
    return [
        {"phase": "policy-0", "env_steps": 100 * (k + 1), "seconds": 2.5 * (k + 1)}
        | {name: draw.uniform(size=policies).tolist() for name in SCORES}
        for k in range(evaluations)
    ]


def test_a_policy_s_curve_is_its_column_of_the_metrics():
    lines = _lines()
    found = curves(["a", "b"], [[1, 0], [0, 0], [0, 1]], lines)
    assert [(curve.row, curve.seed) for curve in found] == [("b", 0), ("a", 0), ("a", 1)]
    for i, curve in enumerate(found):
        np.testing.assert_array_equal(curve.env_steps, [line["env_steps"] for line in lines])
        np.testing.assert_array_equal(curve.seconds, [line["seconds"] for line in lines])
        for name in SCORES:
            np.testing.assert_array_equal(curve.scores[name], [line[name][i] for line in lines])


@pytest.mark.parametrize(("evaluations", "last"), [(1, 1), (4, 1), (10, 1), (11, 2), (20, 2)])
def test_the_last_tenth_has_the_evaluations_after_nine_tenths(evaluations, last):
    chosen = in_last_tenth(np.arange(1, evaluations + 1) * 30.0)
    np.testing.assert_array_equal(chosen, np.arange(evaluations) >= evaluations - last)


def test_a_summary_is_a_mean_over_the_last_tenth_and_the_first_times():
    lines = _lines()
    curve = curves(["a"], [[0, 0]], lines)[0]
    success = np.linspace(0.0, 0.94, 20)
    curve = Curve("a", 0, curve.env_steps, curve.seconds, curve.scores | {SCORES[1]: success})
    found = summary(curve)
    for name in SCORES:
        assert found[name] == pytest.approx(np.mean([curve.scores[name][i] for i in (18, 19)]))
    for level in LEVELS[:2]:
        first = next(i for i, x in enumerate(success) if x >= level / 100)
        assert found[f"steps_{level}"] == 100 * (first + 1)
        assert found[f"seconds_{level}"] == 2.5 * (first + 1)
    assert np.isnan(found["steps_95"])
    assert found["env_steps"] == 2000


def test_a_spread_over_seeds_has_mean_interquartile_mean_and_interval():
    values = np.array([0.0, 90.0, 95.0, 100.0, 85.0])
    found = spread(values)
    assert found.mean == pytest.approx(values.mean())
    assert found.middle == pytest.approx(90.0)
    low, high = interquartile_interval(jax.random.key(0), jnp.asarray(values, jnp.float32))
    assert (found.low, found.high) == (pytest.approx(float(low)), pytest.approx(float(high)))
