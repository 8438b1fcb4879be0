"""How a sweep shares environments out between the starts that it evaluates from."""

import numpy as np
import pytest
from gril_jax.experiments import sweep_training

from gril_jax.rl.training import Scores


@pytest.mark.parametrize(
    ("starts", "num_envs", "parts"),
    [(1, 2, 1), (1, 3, 0), (3, 6, 3), (3, 4096, 4), (3, 8, 4), (3, 20, 5), (3, 4, 0), (2, 4, 2)],
)
def test_parts_are_at_least_the_starts_and_twice_their_number_divides_the_environments(
    starts, num_envs, parts
):
    assert sweep_training._examinations(starts, num_envs) == parts


def test_scores_have_the_names_of_their_starts_and_parts_of_one_start_are_averaged():
    values = np.random.default_rng(0).uniform(size=(4, 5, 3, 2))  # score, policy, part, actions
    found = sweep_training._by_start(["demo", "layout", "layout"], Scores(*values))
    for name, of in zip(Scores._fields, values, strict=True):
        np.testing.assert_allclose(found[name], of[:, 0, 0])
        np.testing.assert_allclose(found[f"{name}_sampled"], of[:, 0, 1])
        layout = (of[:, 1] + of[:, 2]) / 2
        np.testing.assert_allclose(found[f"{name}_layout"], layout[:, 0])
        np.testing.assert_allclose(found[f"{name}_layout_sampled"], layout[:, 1])
    assert len(found) == 16
