"""Rewards along demonstrations beside one encoder after the other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.pipeline import setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations
from gril_jax.experiments.sweeps.named_rows import changed
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import with_seeds
from gril_jax.experiments.table1.profiles import get_ready, measure, profiles, program
from support.kinematic_demos import kinematic_demos

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.metrics.cycles import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

SMALL = {"encoder.width": 4, "encoder.rounds": 0, "encoder.latent": 3, "pool.window": 3}


CONFIG = changed(RunConfig(), SMALL)


@pytest.fixture(scope="module")
def batch():
    found = jax.tree.map(jnp.asarray, kinematic_demos(0, 3, num_objects=4, max_length=14))
    return found._replace(length=jnp.array([14, 9, 12]))


@pytest.fixture(scope="module")
def learned(batch):
    """Two rewards with weights at random."""
    found = []
    for seed in range(2):
        draw = np.random.default_rng(seed)
        blank = setup.blank_reward(CONFIG, 4).encoder
        encoder = jax.tree.map(
            lambda x, d=draw: jnp.asarray(d.normal(size=x.shape), x.dtype), blank
        )
        goal = jnp.asarray(draw.normal(size=3), jnp.float32)
        one = RewardParams(encoder, goal, jnp.float32(0.5), jnp.float32(5.0))
        found.append(LearnedReward(one, 0.0, batch, 4))
    return found


def test_cycle_consistency_is_that_of_each_encoder_and_profiles_are_those_of_the_first(
    batch, learned
):
    static, hyper = setup.pretrain_config(CONFIG, 4), setup.pretrain_hyper(CONFIG)
    found = measure([program(static)], learned, hyper, [batch])

    latents = [pretrain.embed(one.params.encoder, batch, hyper, static) for one in learned]
    cycle = [float(two_way_cycle_consistency(x, batch.length)) for x in latents]
    np.testing.assert_allclose(found["cycle"], cycle, atol=1e-6)
    rewards = -0.5 * np.linalg.norm(latents[0] - learned[0].params.goal, axis=-1)
    for i, values in enumerate(found["success"]):
        np.testing.assert_allclose(values, rewards[i, : batch.length[i]], atol=2e-3)
    assert [len(values) for values in found["success"]] == [14, 9, 12]
    assert found["failure"] == []


def test_a_table_measures_each_row_once_and_rows_alike_share_a_program(tmp_path, batch, learned):
    class Made(Demonstrations):
        def batch(self, split):
            return batch

    demos = Made(None, {"failure": ["a", "b", "c"]}, 0)
    changes = {"one": {}, "other": {"pool.alpha": 2.0}}
    rows = with_seeds(CONFIG, changes, 2)
    rewards = {reward_key(row.config): learned[row.seed] for row in rows}
    static = setup.pretrain_config(CONFIG, 4)
    with run_dir.create(tmp_path / "run", CONFIG, device="cpu") as run, Progress() as progress:
        with ahead.compiling() as pool:
            wanted = get_ready(rows, demos, 4, run, pool)
            assert [one.cell for one in wanted] == [0, 1]
            assert wanted[0].ready is wanted[1].ready
            profiles(wanted, rewards, run, progress)
            assert get_ready(rows, demos, 4, run, pool) == []
        for cell, change in enumerate(changes.values()):
            plain = measure(
                [program(static)] * 2,
                learned,
                setup.pretrain_hyper(changed(CONFIG, change)),
                [batch] * 2,
            )
            assert run.finished_phase(f"profiles-{cell}") == plain
            assert len(plain["failure"]) == 3
