"""Records and rewards of stages along made-up episodes."""

import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.tabletop import reward as rewards
from gril_jax.envs.tabletop.reward import StageProgress

STAGES = 3


def _moment(done, within=0.0, finished=False):
    flags = jnp.arange(STAGES) < done
    return StageProgress(flags, jnp.float32(within), jnp.array(finished))


def _episode(moments):
    record, records = rewards.no_record(STAGES), []
    for time, moment in enumerate(moments):
        record = rewards.record(record, moment, jnp.int32(time))
        records.append(record)
    return records


def test_stage_times_are_the_first_ones():
    times = _episode([_moment(k) for k in (0, 1, 0, 1, 2)])[-1].stage_time
    assert times.tolist() == [1, 4, -1]


def test_success_needs_five_moments_in_a_row():
    finished = [True] * 4 + [False] + [True] * 6
    found = _episode([_moment(3, finished=f) for f in finished])
    assert [bool(r.success) for r in found] == [False] * 9 + [True] * 2


def _rewards(name, moments, change=0.0):
    records = [rewards.no_record(STAGES), *_episode(moments)]
    steps = zip(records[:-1], records[1:], moments, strict=True)
    move = jnp.full(2, change)
    return [float(rewards.reward(name, a, b, m, move)) for a, b, m in steps]


def test_stage_bonuses_are_paid_once():
    found = _rewards("staged", [_moment(k) for k in (0, 1, 0, 1, 2, 1, 2)])
    np.testing.assert_allclose(found, [0, 1 + 1 / 3, 0, 1 / 3, 1 + 2 / 3, 1 / 3, 2 / 3], atol=1e-6)


def test_success_is_paid_once_more():
    moments = [_moment(3, finished=True)] * 7
    found = _rewards("staged", moments)
    np.testing.assert_allclose(found, [4, 1, 1, 1, 6, 1, 1], atol=1e-6)


def test_progress_counts_within_the_next_stage_and_changes_cost():
    found = _rewards("staged", [_moment(0, 0.6)], change=1.0)
    assert found == pytest.approx([0.2 - 0.02])
    assert _rewards("staged", [_moment(3, 0.9)])[0] == pytest.approx(1 + 3)


def test_stage_count_and_sparse_pay_nothing_else():
    moments = [_moment(1, 0.7), *[_moment(3, 0.7, True)] * 5]
    np.testing.assert_allclose(_rewards("stages", moments), [1 / 3, 1, 1, 1, 1, 1], atol=1e-6)
    assert _rewards("sparse", moments) == [0, 0, 0, 0, 0, 1]


def test_closeness_falls_from_one():
    points = [jnp.array([d, 0.0, 0.0]) for d in (0.0, 0.2, 2.0)]
    found = [float(rewards.closeness(p, jnp.zeros(3))) for p in points]
    np.testing.assert_allclose(found, [1, 1 - np.tanh(1.0), 0], atol=1e-4)
