"""Failures that teach: their ends keep away from the goal."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ConfigError, DemoError
from gril_jax.graphs import scene_graph
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.failures import nearness
from gril_jax.pretraining.options import Hyper, Static
from gril_jax.workflows.build import demonstrations

CONFIG = Static(EncoderConfig(4, width=8, rounds=1, latent=3), num_videos=3, updates=60)


def _videos(seed, num):
    found = jax.tree.map(jnp.asarray, kinematic_demos(seed, num, num_objects=4, max_length=14))
    return found._replace(length=jnp.asarray(np.arange(num) % 4 + 9))


@pytest.fixture(scope="module")
def data():
    """Successes and failures with their activity bits, and an encoder."""
    demos, failed, hyper = _videos(0, 4), _videos(1, 3), Hyper()
    bits = [pretrain.activity_bits(x, hyper, CONFIG) for x in (demos, failed)]
    params = jax.jit(encoder.init, static_argnums=1)(jax.random.key(0), CONFIG.encoder)
    return params, demos, bits[0], failed, bits[1]


def _latent(params, videos, bits, i, at):
    graph = scene_graph(
        videos.center[i, at], videos.size[i, at], videos.label[i], videos.is_robot[i], bits[i, at],
        videos.present[i],
    )  # fmt: skip
    return np.asarray(encoder.apply(params, graph, CONFIG.encoder, alpha=Hyper().alpha))


@pytest.mark.parametrize("goals", [1, 4])
@pytest.mark.parametrize("margin", [0.0, 0.4, 1.5])
def test_it_is_the_mean_square_of_what_is_lacking(data, goals, margin):
    params, demos, bits, failed, failed_bits = data
    config, hyper = dataclasses.replace(CONFIG, goals=goals), Hyper(failure_margin=margin)
    last = [_latent(params, demos, bits, i, int(demos.length[i]) - 1) for i in range(4)]
    first = [_latent(params, demos, bits, i, 0) for i in range(4)]
    ends = [_latent(params, failed, failed_bits, i, int(failed.length[i]) - 1) for i in range(3)]
    chosen = last if goals > 1 else [np.mean(last, axis=0)]
    away = lambda x: min(np.linalg.norm(x - goal) for goal in chosen)  # noqa: E731
    scale = np.mean([away(x) for x in first])
    wanted = np.mean([max(margin - away(x) / scale, 0.0) ** 2 for x in ends])
    found = jax.jit(nearness, static_argnums=6)(*data, hyper, config)
    assert float(found) == pytest.approx(wanted, rel=1e-3, abs=1e-6)


def test_training_drives_failures_away_from_the_goal(data):
    """Failures that end as the successes do, but for one object."""
    _, demos, _, _, _ = data
    failed = demos._replace(center=demos.center.at[:, :, 3].add(0.3))
    hyper = Hyper(learning_rate=3e-3, failure_margin=1.0, decay_updates=1e9)

    def short(failures):
        state = pretrain.init(jax.random.key(0), demos, CONFIG)
        for _ in range(3):
            state, _ = pretrain.step(state, demos, hyper, CONFIG, None, None, failures)
        bits = [pretrain.activity_bits(x, hyper, CONFIG) for x in (demos, failed)]
        return float(nearness(state.params.encoder, demos, bits[0], failed, bits[1], hyper, CONFIG))

    assert short(failed) < 0.5 * short(None)


def test_a_reward_that_predicts_progress_learns_from_none(data):
    config = dataclasses.replace(CONFIG, consistency="timerewarder")
    state = pretrain.init(jax.random.key(0), data[1], config)
    with pytest.raises(ConfigError, match="no pool and no failures"):
        pretrain.step(state, data[1], Hyper(), config, None, None, data[3])


@pytest.mark.parametrize(
    ("share", "teach"), [(0.0, []), (0.5, [1, 3]), (0.25, [3]), (1.0, [0, 1, 2, 3, 4])]
)
def test_a_failure_teaches_or_measures(share, teach):
    names = [f"f{i}" for i in range(5)]
    found = demonstrations._shared_out(names, share, "set")
    assert found["teaching failure"] == [names[i] for i in teach]
    assert found["failure"] == [names[i] for i in range(5) if i not in teach]


def test_a_set_without_failures_is_told_so():
    with pytest.raises(DemoError, match=r"mine: holds no failures, so pretrain.failures must be 0"):
        demonstrations._shared_out([], 0.5, "mine")
