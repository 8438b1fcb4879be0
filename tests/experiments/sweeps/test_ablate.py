"""The ablation of encoder training: cases that differ where their names say, grouped by program."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.pipeline import demonstrations, setup
from gril_jax.experiments.sweeps import ablate
from gril_jax.experiments.sweeps.named_rows import changed
from support.kinematic_demos import kinematic_demos

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.pretraining import pretrain

CONFIG = changed(
    RunConfig(),
    {
        "pretrain.steps": 2,
        "pretrain.num_videos": 3,
        "pretrain.num_frames": 6,
        "encoder.width": 8,
        "encoder.rounds": 1,
        "encoder.latent": 4,
    },
)


@pytest.fixture(scope="module")
def train():
    return jax.tree.map(jnp.asarray, kinematic_demos(0, 4, num_objects=5))


def test_every_case_but_the_first_and_the_untrimmed_changes_the_training():
    def training(change):
        config = changed(CONFIG, change)
        return setup.pretrain_config(config, 7), setup.pretrain_hyper(config)

    same = [name for name, change in ablate.CASES.items() if training(change) == training({})]
    wanted = ["as configured", "1 round of messages", "static tails not trimmed"]
    assert same == wanted  # one round is this test's own configuration


def test_cases_of_one_program_are_measured_together():
    groups = ablate.groups(CONFIG)
    assert sorted(name for names in groups.values() for name in names) == sorted(ablate.CASES)
    (first,) = [names for names in groups.values() if "as configured" in names]
    assert {"lambda 10", "temperature 0.1", "alpha 20"} < set(first)
    assert ["static tails not trimmed"] in groups.values()


@pytest.mark.slow
def test_a_case_is_what_a_run_by_itself_with_its_seed_gives(train):
    found = ablate.measure(CONFIG, ["as configured", "alpha 20"], train, train, 7, 2)
    assert {name: row["tau"].shape for name, row in found.items()} == {
        "as configured": (2,),
        "alpha 20": (2,),
    }
    config = changed(CONFIG, {"pool.alpha": 20.0})
    static, hyper = setup.pretrain_config(config, 7), setup.pretrain_hyper(config)
    state = pretrain.init(jax.random.split(jax.random.key(0), 2)[1], train, static)
    state, _ = pretrain.step(state, train, hyper, static)
    alone = pretrain.evaluate(state.params.encoder, train, train, hyper, static)
    np.testing.assert_allclose(found["alpha 20"]["reward_last"][1], alone["reward_last"], rtol=1e-3)


def test_an_untrimmed_video_stands_still_at_its_end(train):
    held = ablate.untrimmed(train, [0, 5, 10, 200])
    np.testing.assert_array_equal(held.length - train.length, [0, 5, 10, 200])
    for before, after, old, new in zip(
        train.center, held.center, train.length, held.length, strict=True
    ):
        np.testing.assert_array_equal(after[:old], before[:old])
        assert (after[old:new] == before[old - 1]).all()
    assert held.center.shape[1] == max(held.length)


def test_a_value_out_of_range_is_refused():
    with pytest.raises(ConfigError, match=r"pool\.alpha is 0"):
        changed(CONFIG, {"pool.alpha": 0.0})


def test_the_table_has_mean_and_range():
    row = {m: np.array([0.1, 0.3]) for m in ("tau", "reward_time_tau", "reward_last")}
    assert "| a case | 0.200 (0.100 to 0.300) |" in ablate.markdown({"a case": row}, 2)


def test_demonstrations_know_what_was_trimmed_of_each():
    entry = dataclasses.make_dataclass("entry", ["name", "trimmed"])
    entries = [entry("a", 3), entry("b", 4), entry("c", 5)]
    demo_set = type("Set", (), {"entries": entries})()
    demos = demonstrations.Demonstrations._make([demo_set, {"train": ["c", "a"]}, 12])
    assert demos.trimmed_of("train") == [5, 3]
