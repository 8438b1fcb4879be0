"""Marks of failures on made-up positions."""

import numpy as np
import pytest
from gril_jax.envs.tabletop.tasks.shoes_in_box import shows

BOX = np.array([0.5, -0.15])
TABLE, FAR, INSIDE, ALOFT, ON_LID = (
    (0.5, 0.14, 0.025), (0.7, 0.14, 0.025), (0.5, -0.15, 0.03), (0.5, 0.0, 0.3), (0.5, -0.15, 0.186)
)  # fmt: skip
OPEN, SHUT = 2.6, 0.0


def _episode(a, b, lid):
    """Places of both shoes and the lid's angle, moment by moment."""
    shoes = np.stack([np.array(a, float), np.array(b, float)], axis=1)
    inside = np.linalg.norm(shoes[-1] - INSIDE, axis=1) < 0.05
    return shoes, np.array(lid), inside, BOX


EPISODES = {
    "lid only": _episode([TABLE] * 2, [TABLE] * 2, [SHUT, OPEN]),
    "one shoe": _episode([TABLE, ALOFT, INSIDE], [TABLE] * 3, [SHUT, OPEN, OPEN]),
    "shoe outside": _episode([TABLE, ALOFT, INSIDE], [TABLE, ALOFT, TABLE], [SHUT, OPEN, OPEN]),
    "lid closed again": _episode([TABLE] * 3, [TABLE] * 3, [SHUT, OPEN, SHUT]),
    "wrong order": _episode([TABLE, ALOFT, ON_LID], [TABLE] * 3, [SHUT] * 3),
    "shoe knocked away": _episode([TABLE, ALOFT, INSIDE], [TABLE, FAR, FAR], [SHUT, OPEN, OPEN]),
}
ALSO = {("shoe knocked away", "one shoe")}  # a struck shoe also was not taken


@pytest.mark.parametrize("made", EPISODES)
@pytest.mark.parametrize("kind", EPISODES)
def test_an_episode_shows_its_own_kind_and_no_other(made, kind):
    assert shows(kind, *EPISODES[made]) == (made == kind or (made, kind) in ALSO)


@pytest.mark.parametrize("made", EPISODES)
def test_any_episode_can_have_stopped_early(made):
    assert shows("stops early", *EPISODES[made])
