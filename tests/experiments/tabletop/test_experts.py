"""Figures of the scripted experts on the table, and when stages are seen for good."""

import json

import numpy as np
import pytest
from gril_jax.envs.stages import Stage, Stages
from gril_jax.experiments.tabletop import experts


@pytest.fixture(scope="module")
def stages():
    """Two things; a stage for each, which holds at its right half."""
    at_right = [
        Stage(name, (i,), lambda c, s, i=i: c[i, 0] > 0, lambda k, c, s: c)
        for i, name in enumerate(("first", "second"))
    ]
    return Stages(tuple(at_right), (0, 1), 1.0, lambda task, c, s: 0.0)


def _film(*places):
    """Boxes of a film from the places of both things, moment by moment."""
    center = np.stack([np.array(places, np.float32), np.zeros((len(places), 2))], axis=-1)
    return center, np.ones_like(center)


def test_a_stage_is_seen_for_good_from_when_it_holds_until_the_end(stages):
    film = _film((1, -1), (1, 1), (1, -1), (1, 1), (1, 1))
    assert experts.seen_for_good(stages, *film).tolist() == [0, 3]
    film = _film((-1, 1), (1, 1), (1, -1))
    assert experts.seen_for_good(stages, *film).tolist() == [1, -1]


def test_a_film_agrees_if_all_its_stages_are_seen_in_time(stages):
    late = [(-1, 1)] * (experts.NEAR + 2) + [(1, 1)]
    films = [
        (*_film((-1, 1), (1, 1)), np.array([1, 0])),
        (*_film(*late), np.array([0, 0])),
        (*_film((1, -1)), np.array([0, 0])),
    ]
    found = experts.agreement(stages, films)
    assert (found["films"], found["agree"]) == (3, 0.3333)
    assert found["median_frames_off"] == [0, 0]


def test_the_command_prints_the_figures_of_a_task(capsys):
    assert experts.main(["--tasks", "umbrella_out", "--starts", "3", "--failures", "1"]) == 0
    found = json.loads(capsys.readouterr().out)["umbrella_out"]
    assert found["starts"] == found["succeeded"] == 3
    assert found["unplaced"] == 0
    assert found["stages_by_whole_boxes"]["agree"] == 1
    kinds = found["failures_as_meant"]
    assert kinds.pop("of") == 1
    assert len(kinds) == 6


def test_an_unknown_task_is_named(capsys):
    assert experts.main(["--tasks", "umbrela_out"]) == 2
    assert "'umbrela_out' is no task here: these are shoes_in_box" in capsys.readouterr().err
