"""Training in rounds: each reward learns from the policies before it."""

import re
import shutil
from pathlib import Path

import pytest
from support import own_task
from support.run_folders import save_run

from gril_jax.cli import main
from gril_jax.config import RunConfig, RunSettings
from gril_jax.runs.reading import read_phases, read_results
from gril_jax.workflows import rounds

TRAIN = (
    "train", "small.yaml", "--task", "my_task.py:make", "--demos", "mine", "--out", "run",
    "--reward", "learned", "--ppo.sub-policies", "1",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    return own_task.home(tmp_path, monkeypatch)


def test_each_round_is_a_run_that_learns_from_the_last_ones_before_it(folder, capsys, monkeypatch):
    monkeypatch.setattr(rounds, "AT_MOST", 1)
    assert main.main([*TRAIN, "--rounds", "3"]) == 0
    said = capsys.readouterr().out
    names = [f"round-{k}" for k in (1, 2, 3)]
    assert sorted(x.name for x in (folder / "run").iterdir()) == names
    for number, before in ((1, []), (2, [1]), (3, [2])):
        run = folder / "run" / f"round-{number}"
        noted = read_phases(run).finished.get("hard_negatives_of", {"runs": []})["runs"]
        assert noted == [str(folder / "run" / f"round-{k}") for k in before]
        results = read_results(run)
        line = next(x for x in said.splitlines() if x.startswith(f"round {number}: "))
        assert f"{100 * results['success']:.1f}%" in line
        taught = results["hard_negatives"]
        assert (f"{taught} states of earlier policies" in line) == (taught > 0)
        assert taught > 0 or not before
    shares = [float(x) for x in re.findall(r"([\d.]+)% of episodes end as the videos do", said)]
    assert len(shares) == 3
    best = shares.index(max(shares)) + 1
    assert f"most often like the videos ends the policy of round {best}: run/round-{best}" in said


def test_rounds_that_the_videos_cannot_judge_have_no_name(tmp_path, monkeypatch):
    """As in a variant with other objects: the rounds themselves are kept and told."""
    config = RunConfig(run=RunSettings(out=str(tmp_path / "out")))
    monkeypatch.setattr(
        rounds.train,
        "main",
        lambda own, **_: save_run(Path(own.run.out), config=own) or own.run.out,
    )
    for found, named in (({}, False), ({"ends_as_videos": 0.5}, True)):
        monkeypatch.setattr(rounds.evaluate, "main", lambda folder, found=found, **_: found)
        said = []
        rounds.main(config, rounds=2, echo=said.append)
        assert "round 2: success with deterministic actions: 90.0%" in "".join(said)
        assert any("policy of round 1" in line for line in said) == named  # the first of equals
        shutil.rmtree(tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--rounds", "0"], "--rounds is 0, but must be from 1 to 8"),
        (
            ["--rounds", "2", "--dry-run"],
            "must be 1 beside --resume, --hard-negatives or --dry-run",
        ),
        (["--rounds", "2", "--hard-negatives", "other"], "must be 1 beside --resume"),
        (["--rounds", "2", "--reward", "environmental"], "where no reward and policy are learned"),
        (["--rounds", "2", "--loss.consistency", "rewind"], "or predicts progress: hard negatives"),
    ],
)
def test_rounds_that_have_nothing_to_learn_are_told_so(folder, capsys, options, why):
    plain = ["--pretrain.num-perturbations", "0", "--pretrain.adversarial-steps", "0"]
    assert main.main([*TRAIN, *plain, *options]) == 2
    assert why in capsys.readouterr().err
    assert not (folder / "run").exists()
