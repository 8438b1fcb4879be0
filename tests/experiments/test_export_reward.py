"""A run's reward as one file."""

import dataclasses

import jax
import numpy as np
import pytest
from support.run_folders import save_run
from support.saved_rewards import made

from gril_jax import envs
from gril_jax.cli import main
from gril_jax.config import EncoderOptions, EnvConfig, LossConfig, PretrainConfig, RunConfig
from gril_jax.errors import RunError
from gril_jax.export.reward_file import RewardFileError, load_reward
from gril_jax.losses import heads
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.workflows import export_reward
from gril_jax.workflows.build import setup

ENV = EnvConfig(targets=("green star",), distractors=("blue pentagon",), variant="layout")
CONFIG = dataclasses.replace(RunConfig(), env=ENV, encoder=EncoderOptions(width=8, latent=4))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = save_run(tmp_path_factory.mktemp("runs") / "one", config=CONFIG, ppo=0)
    num_classes = len(envs.make("match_regions").classes)
    params = made(setup.encoder_config(CONFIG, num_classes))
    checkpoint.save(folder / "reward", 5, params)
    return folder, params


def test_the_file_holds_the_runs_reward_and_what_it_depends_on(run, tmp_path):
    folder, params = run
    said = []
    export_reward.main(folder, tmp_path / "reward.npz", echo=said.append)
    learned = load_reward(tmp_path / "reward.npz")
    assert jax.tree.all(jax.tree.map(np.array_equal, learned.params, params))
    assert learned.objects == ("goal", "robot", "green star", "blue pentagon")
    assert learned.robots == ("robot",)
    assert learned.activity[:2] == (CONFIG.pool.tau, CONFIG.pool.window)
    about = learned.about
    assert about["half_extent"] > 1
    assert about["provenance"]["kendall_tau"] == 0.912
    assert len(about["provenance"]["demos_sha256"]) == 64
    assert said == [f"wrote {tmp_path / 'reward.npz'}"]
    with pytest.raises(RewardFileError, match="exists already"):
        export_reward.main(folder, tmp_path / "reward.npz", echo=said.append)


def test_a_run_without_a_reward_is_refused(tmp_path):
    folder = save_run(tmp_path / "one", config=CONFIG, ppo=0)
    with pytest.raises(RunError, match="has no reward"):
        export_reward.main(folder, tmp_path / "reward.npz")


def test_progress_is_of_a_reward_and_of_a_lerobot_dataset(run, tmp_path, capsys):
    asked = ["export", str(run[0]), "--progress", str(tmp_path), "--out", str(tmp_path / "p")]
    assert main.main([*asked, "--what", "policy"]) == 2
    assert "--progress is of the reward, but --what is policy" in capsys.readouterr().err
    assert main.main(asked) == 2
    assert "must be the folder of a LeRobot dataset" in capsys.readouterr().err


def test_a_configuration_takes_the_head_of_a_reward_or_none():
    config = setup.encoder_config(CONFIG, 3)
    params = made(config)
    head = heads.of("rewind").init(jax.random.key(0), config.latent)
    plain = LearnedReward(params, config, ("goal", "robot", "square"))
    progress = dataclasses.replace(
        plain, params=params._replace(head=head, start=np.zeros(config.latent))
    )
    for begun, learned, method in (
        ("tcc", progress, "rewind"), ("sarm", progress, "rewind"), ("sarm", plain, "tcc"),
        ("tcc_huber", plain, "tcc_huber"),
    ):  # fmt: skip
        copies = PretrainConfig(num_perturbations=2 if begun == "tcc" else 0)
        given = dataclasses.replace(CONFIG, loss=LossConfig(consistency=begun), pretrain=copies)
        assert export_reward.with_choices(given, learned, "it").loss.consistency == method
