"""What is measured of encoders on demonstrations, beside one encoder after the other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.export.reward_file import load_reward
from gril_jax.metrics.order import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study import measures
from gril_jax.workflows.study.recipe import Study, changed
from gril_jax.workflows.study.rewards import TrainedReward, reward_key
from gril_jax.workflows.study.saved import Plan, Row

SMALL = {"encoder.width": 4, "encoder.rounds": 0, "encoder.latent": 3}


CONFIG = changed(RunConfig(), SMALL)


@pytest.fixture(autouse=True)
def classes(monkeypatch):
    """The demonstrations here have four classes."""
    monkeypatch.setattr(measures, "num_classes", lambda config: 4)


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
        found.append(TrainedReward(one, 0.0, batch, 4))
    return found


def _made(batch):
    """Demonstrations whose splits are all the same."""

    class Made(Demonstrations):
        def batch(self, split):
            return batch

    return Made(None, {"failure": ["a", "b", "c"]}, 0)


def test_profiles_are_those_of_each_encoder(batch, learned):
    one = measures.Profiles(lambda config: _made(batch))
    found = one.measure(one.compile(CONFIG, 2), CONFIG, learned)
    static, hyper = setup.embedding_config(CONFIG, 4), setup.pretrain_hyper(CONFIG)
    latents = [pretrain.embed(one.params.encoder, batch, hyper, static) for one in learned]
    cycle = [float(two_way_cycle_consistency(x, batch.length)) for x in latents]
    np.testing.assert_allclose(found["cycle"], cycle, atol=1e-6)
    for i, each in enumerate(learned):
        alone = pretrain.figures(each.params, latents[i], batch.length)
        for name in ("reward_time_tau", "reward_last"):
            np.testing.assert_allclose(found[name][i], alone[name], rtol=1e-3)
    rewards = -0.5 * np.linalg.norm(latents[0] - learned[0].params.goal, axis=-1)
    for kind in ("success", "failure"):
        assert [len(values) for values in found[kind]] == [14, 9, 12]
        for i, values in enumerate(found[kind]):
            np.testing.assert_allclose(values, rewards[i, : batch.length[i]], atol=2e-3)


def test_a_table_measures_each_row_once_and_rows_alike_share_a_program(tmp_path, batch, learned):
    one = measures.Profiles(lambda config: _made(batch))
    configs = [changed(CONFIG, change) for change in ({}, {"pool.alpha": 2.0})]
    rows = [
        Row(cell, seed, with_seed(one, seed)) for cell, one in enumerate(configs) for seed in (0, 1)
    ]
    rewards = {reward_key(row.config): learned[row.seed] for row in rows}
    written = []
    with run_dir.create(tmp_path / "run", CONFIG, device="cpu") as run, Progress() as progress:
        with ahead.compiling() as pool:
            needs = lambda rows: frozenset({f"reward-{rows[0].cell}"})  # noqa: E731
            given = ([one], rows, rewards, needs, run, pool, progress, lambda: written.append(1))
            found = measures.tasks(*given)
            assert [task.name for task in found] == ["profiles-0", "profiles-1"]
            assert [task.needs for task in found] == [{"reward-0"}, {"reward-1"}]
            assert found[0].wanted is found[1].wanted
            for task in found:
                task.do()
            assert measures.tasks(*given) == []
        assert len(written) == 2
        for cell, config in enumerate(configs):
            plain = one.measure(one.compile(config, 2), config, learned)
            assert run.finished_phase(f"profiles-{cell}") == plain


def test_rows_without_a_learned_reward_or_of_pictures_are_not_measured(tmp_path):
    configs = [
        changed(CONFIG, {"run.reward": "environmental"}),
        changed(CONFIG, {"encoder.kind": "pixels"}),
    ]
    compiled = measures.Profiles(lambda config: None)
    with (
        ahead.compiling() as pool,
        Progress() as progress,
        run_dir.create(tmp_path / "run", CONFIG, device="cpu") as run,
    ):
        rows = [Row(cell, 0, one) for cell, one in enumerate(configs)]
        none = lambda *_: frozenset()  # noqa: E731
        given = (rows, {}, none, run, pool, progress, none)
        assert measures.tasks([compiled], *given) == []
        assert [task.name for task in measures.tasks([measures.Tau()], *given)] == ["tau-1"]


def test_a_reward_that_diverged_has_no_numbers_and_the_others_keep_theirs():
    rewards = [TrainedReward(None, 0.5, None, 4, said) for said in (None, "it diverged", None)]
    found = {"tau": [0.5, 0.5, 0.7], "success": [[-1.0, 0.0]], "files": ["a", "b", "c"], "n": 3}
    kept = measures._kept(found, rewards)
    assert kept == found | {"tau": [0.5, None, 0.7]}


def test_a_reward_file_has_the_name_of_a_row_that_learned_it(tmp_path):
    own = changed(CONFIG, {"run.reward": "environmental"})
    rows = {"its own": own, "left out": CONFIG, "ours": CONFIG}
    plan = Plan(Study("test"), CONFIG, rows, {"its own": [0], "ours": [0]})
    words = setup.make_env(CONFIG.env, training=False).classes
    params = jax.tree.map(lambda x: jnp.ones(x.shape), setup.blank_reward(CONFIG, len(words)))
    found = [TrainedReward(params, 0.0, None, 4)]
    assert measures.Files(plan, tmp_path).measure(None, CONFIG, found) == {"files": ["ours-0"]}
    assert load_reward(tmp_path / "rewards" / "ours-0.npz").classes == tuple(words)
    noisy = changed(CONFIG, {"pool.noise": 0.01, "run.seed": 5})
    plan = plan._replace(config=noisy, rows={"ours": noisy}, work={"ours": [0, 1]})
    measures.Files(plan, tmp_path).measure(None, noisy, found * 2)
    for seed in (5, 6):
        learned = load_reward(tmp_path / "rewards" / f"ours-{seed}.npz")
        assert learned.activity._asdict() == noisy.pool.rule()
        assert learned.about["provenance"]["seed"] == seed
