"""Rewards of stages: each way against what it comes down to in a plain case."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.stage_rewards import segments, ways
from support.kinematic_demos import kinematic_demos

from gril_jax import reward
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.options import Hyper, Static
from gril_jax.reward import chain

STATIC = Static(
    EncoderConfig(7, width=8, latent=4, rounds=1), updates=5, num_videos=2, num_frames=6
)
HYPER = Hyper(*map(float, Hyper(decay_updates=10.0)))
KEY = jax.random.fold_in(jax.random.key(0), 0)


@functools.cache
def _films():
    films = jax.device_put(kinematic_demos(0, 4))
    return films, pretrain.activity_bits(films, HYPER, STATIC)


@functools.cache
def _shared():
    return ways.trained(KEY, _films()[0], HYPER, STATIC, 10)


def _equal(one, other):
    jax.tree.map(np.testing.assert_array_equal, one, other)


def test_an_encoder_is_what_the_library_trains():
    films, _ = _films()
    state = pretrain.init(KEY, films, STATIC)
    for _ in range(2):
        state, _ = pretrain.step(state, films, HYPER, STATIC)
    assert _shared().steps == 10
    _equal(_shared().encoder, state.params.encoder)


def test_a_fresh_encoder_of_segments_that_are_whole_films_is_the_ordinary_one():
    films, bits = _films()
    parts = segments.cut(films, bits, np.asarray(films.length)[:, None] - 1)
    (only,) = ways.fresh(KEY, parts, HYPER, STATIC, 10, share=False).stages
    _equal(only.learned, pretrain.learned_reward(_shared().encoder, films, HYPER, STATIC))
    (shared,) = ways.fresh(KEY, parts, HYPER, STATIC, 10, share=True).stages
    _equal(shared.learned, only.learned)
    (goal,) = ways.goals(_shared(), parts, HYPER, STATIC).stages
    _equal(goal.learned, only.learned)


def test_a_fresh_encoder_sees_nothing_but_its_segments():
    films, bits = _films()
    ends = np.stack([np.full(4, 30), np.asarray(films.length) - 1], axis=1)
    later = films._replace(center=films.center.at[:, 31:].add(0.1))
    found = [
        ways.fresh(KEY, segments.cut(x, bits, ends), HYPER, STATIC, 10, share=False)
        for x in (films, later)
    ]
    _equal(found[0].stages[0], found[1].stages[0])
    first, second = (way.stages[1].learned.encoder for way in found)
    assert any((a != b).any() for a, b in zip(*map(jax.tree.leaves, (first, second)), strict=True))
    assert found[0].restarts
    assert found[0].steps == 20


def test_shared_steps_are_as_many_in_all():
    films, bits = _films()
    parts = segments.cut(films, bits, np.array([[30, 60]] * 4))
    assert ways.fresh(KEY, parts, HYPER, STATIC, 10, share=True).steps == 10


def test_goals_are_those_of_the_chain():
    films, bits = _films()
    ends = np.stack([np.full(4, 30), np.asarray(films.length) - 1], axis=1)
    latents = reward.demo_latents(
        _shared().encoder, films, STATIC.encoder, alpha=HYPER.alpha, active=bits
    )
    linked = chain.from_latents(latents, jnp.asarray(ends), films.length)
    way = ways.goals(_shared(), segments.cut(films, bits, ends), HYPER, STATIC)
    for number, stage in enumerate(way.stages):
        np.testing.assert_allclose(stage.learned.goal, linked.goals[number], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(stage.learned.scale, linked.scale[number], rtol=1e-5)
    assert not way.restarts


def test_a_landing_is_where_the_stage_before_ends():
    learned = pretrain.learned_reward(_shared().encoder, _films()[0], HYPER, STATIC)
    way = ways.landings(_shared(), learned, jnp.array([-0.6, -0.3, 0.0]))
    assert [float(stage.floor) for stage in way.stages] == [-1e6, *map(np.float32, (-0.6, -0.3))]
    assert all(stage.learned is learned for stage in way.stages)
