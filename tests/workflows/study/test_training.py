"""The scores of a table's policies while they learn, by their names."""

import numpy as np

from gril_jax.rl.training import Scores
from gril_jax.workflows.study import programs


def test_scores_have_the_names_of_their_starts_and_parts_of_one_start_are_averaged():
    values = np.random.default_rng(0).uniform(size=(4, 5, 3, 2))  # score, policy, part, actions
    found = programs._by_start(["demo", "layout", "layout"], Scores(*values))
    for name, of in zip(Scores._fields, values, strict=True):
        np.testing.assert_allclose(found[name], of[:, 0, 0])
        np.testing.assert_allclose(found[f"{name}_sampled"], of[:, 0, 1])
        layout = (of[:, 1] + of[:, 2]) / 2
        np.testing.assert_allclose(found[f"{name}_layout"], layout[:, 0])
        np.testing.assert_allclose(found[f"{name}_layout_sampled"], layout[:, 1])
    assert len(found) == 16
