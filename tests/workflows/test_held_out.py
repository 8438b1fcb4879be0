"""Figures of rewards along videos: with resting ends, and with failures, beside scipy."""

import jax.numpy as jnp
import numpy as np
import scipy.stats

from gril_jax.demos.demo import Demo, Tracks
from gril_jax.workflows import held_out

REWARD = np.random.default_rng(0).random((5, 12)) + np.linspace(0, 1, 12)
LENGTH, TRIMMED = jnp.array([12, 7, 5, 9, 4]), jnp.array([0, 9, 3, 50, 2])


def _demo(outcome, stages=None):
    place = np.zeros((4, 1, 2), np.float32)
    tracks = Tracks(place, place + 1, np.zeros(1, np.int32), np.ones((4, 1), bool))
    return Demo("a", np.zeros((4, 2, 2, 3), np.uint8), tracks, 3, outcome, stages)


def test_successes_are_above_failures_which_are_in_order_of_finished_stages():
    made = [
        _demo("failure"), _demo("failure", {"lid": 4, "shoe": -1}),
        _demo("failure", {"lid": 4, "shoe": 9}), _demo("unknown"),
    ]  # fmt: skip
    ranks = [held_out.rank(one) for one in made]
    assert ranks[:3] == [0, 1, 2]
    assert ranks[3] == held_out.rank(_demo("success", {"lid": -1})) > 2


def test_resting_ends_hold_the_last_reward_and_failures_do_not_count_in_time():
    along = jnp.asarray(REWARD, jnp.float32)
    ranks = jnp.array([9, 9, 9, 0, 0])
    found = held_out.figures(along, LENGTH, TRIMMED, ranks, held=3)
    oracles = {
        "voc_pearson": scipy.stats.pearsonr,
        "voc_spearman": scipy.stats.spearmanr,
        "reward_time_tau": scipy.stats.kendalltau,
    }
    cut = [row[:n] for row, n in zip(REWARD[:3], LENGTH, strict=False)]
    whole = [np.r_[x, [x[-1]] * int(n)] for x, n in zip(cut, TRIMMED, strict=False)]
    for name, oracle in oracles.items():
        for suffix, videos in (("", cut), ("_tails", whole)):
            expected = np.mean([oracle(np.arange(len(x)), x).statistic for x in videos])
            np.testing.assert_allclose(found[name + suffix], expected, atol=1e-5)
    assert found.keys() - {name + x for name in oracles for x in ("", "_tails")} == {
        "auc_final", "preference_accuracy", "policy_ranking",
    }  # fmt: skip


def test_last_rewards_are_ranked():
    along = jnp.array([[0.0, 1.0, 9.0], [0.0, 0.4, 0.6], [0.5, 9.0, 9.0], [0.0, 0.2, 0.8]])
    best = held_out.rank(_demo("success"))
    ranks = jnp.array([best, best, 0, 1])
    found = held_out.last_ranked(along, jnp.array([2, 3, 1, 3]), ranks)  # last: 1, 0.6, 0.5, 0.8
    np.testing.assert_allclose(found["auc_final"], 3 / 4)
    np.testing.assert_allclose(found["preference_accuracy"], 4 / 5)
    np.testing.assert_allclose(found["policy_ranking"], (1 + 1 + 0) / 3, rtol=1e-6)


def test_lines_tell_what_is_known_alone():
    assert held_out.lines({"touch_share": 0.0}) == []
    found = {"voc_pearson": 0.5, "voc_pearson_tails": 0.25, "auc_final": None, "held_out": 3}
    head, line = held_out.lines(found)
    assert head == "rewards along 3 held-out videos, which have no threshold:"
    assert line.startswith("voc_pearson          0.500  Pearson's ")
    assert line.endswith("; 0.250 with resting ends")
