"""The comparison as a command: a set of made-up films in, figures and a table out."""

import json

import numpy as np
import pytest
from gril_jax.experiments.stage_rewards import compare
from support.kinematic_demos import kinematic_demos

from gril_jax import envs
from gril_jax.demos.demo_set import Demo, save_demo_set
from gril_jax.demos.vision.detect import Tracks

SMALL = (
    "--encoder.width", "8", "--encoder.latent", "4", "--encoder.rounds", "1",
    "--pretrain.steps", "20", "--pretrain.num-videos", "2", "--pretrain.num-frames", "6",
)  # fmt: skip
WAYS = ["landings", "goals", "fresh", "fresh, steps shared"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Films of blocks that are carried to the region, with the task's objects."""
    env = envs.make("match_regions")
    films, made = kinematic_demos(0, 8), []
    names = ("goal", "robot", *env.blocks)
    label = np.array([env.classes.index(name) for name in names], np.int32)
    for b, length in enumerate(films.length):
        center, size = films.center[b, :length], films.size[b, :length]
        tracks = Tracks(center, size, label, np.ones(center.shape[:2], bool))
        frames = np.zeros((length, 16, 16, 3), np.uint8)
        made.append(Demo(f"d{b}", frames, tracks, 0, "success"))
    path = tmp_path_factory.mktemp("films") / "set"
    save_demo_set(
        path, made, task="match_regions", classes=tuple(env.classes), fps=8.0, source="-",
        half_extent=env.half_extent,
    )  # fmt: skip
    return path


def test_figures_of_every_way_and_stage_are_printed(folder, capsys):
    few = ("--seeds", "2", "--cuts", "true", "--number", "20", "--ascents", "2")
    args = [*few, "match_regions_fast", "--demos.path", str(folder), *SMALL]
    assert compare.main(args) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)["found"]
    assert [one["seed"] for one in found] == [0, 1]
    for one in found:
        assert (one["stages"], one["frames_off"]) == (2, [0, 0])
        assert list(one["ways"]) == WAYS
        for way in one["ways"].values():
            assert len(way["stages"]) == 2
            assert set(way["stages"][1]) == set(compare.FIGURES)
        counts = [[s["made_up"] for s in way["stages"]] for way in one["ways"].values()]
        assert counts == counts[:1] * 4  # all are asked about the same states
        steps = [one["ways"][name]["steps"] for name in WAYS]
        assert steps == [20, 20, 40, 20]
    lines = said.err.strip().splitlines()[-8:]
    assert lines[0].startswith("| landings: 1 of 2 | 2 | ")
    assert lines[-1].startswith("| fresh, steps shared: 2 of 2 | 2 | ")


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["match_regions_fast"], "a set, --demos.path, and a task with stages"),
        (["match_regions_fst"], "there is no configuration 'match_regions_fst'"),
        ([], "the name of a configuration is missing"),
    ],
)
def test_what_cannot_be_compared_is_a_sentence(args, words, capsys):
    assert compare.main(args) == 2
    assert words in capsys.readouterr().err
