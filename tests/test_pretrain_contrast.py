"""Frames with objects displaced: what may be moved, and what the loss makes of it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import encoder, pretrain_contrast, reward
from gril_jax.encoder import EncoderConfig
from gril_jax.final_places import final_places, misplacement
from gril_jax.pretrain_options import Hyper, PretrainConfig
from gril_jax.types import DemoBatch

# Region, robot, a block that the video moves, one that it does not, and padding.
FIRST = np.array([[0.5, 0.5], [-0.9, 0.0], [-0.5, 0.0], [0.0, -0.6], [0.0, 0.0]], np.float32)
LAST = np.array([[0.5, 0.5], [0.3, 0.4], [0.5, 0.6], [0.0, -0.6], [0.0, 0.0]], np.float32)
EXTENT = 1.1
FRAMES = 6
CONFIG = PretrainConfig(EncoderConfig(4, width=8, rounds=1, latent=4), copies=3, anchors=4)


def _demos(num=3):
    share = np.linspace(0, 1, FRAMES)[:, None, None]
    path = (FIRST + share * (LAST - FIRST)).astype(np.float32)
    return DemoBatch(
        center=jnp.tile(path, (num, 1, 1, 1)),
        size=jnp.full((num, FRAMES, 5, 2), 0.2),
        label=jnp.tile(jnp.array([0, 1, 2, 3, 0]), (num, 1)),
        is_robot=jnp.tile(jnp.arange(5) == 1, (num, 1)),
        present=jnp.tile(jnp.arange(5) < 4, (num, 1)),
        length=jnp.full(num, FRAMES),
    )


@pytest.fixture(scope="module")
def demos():
    return _demos()


@pytest.fixture(scope="module")
def places(demos):
    return final_places(demos, CONFIG.encoder.num_classes)


@pytest.fixture(scope="module")
def made(demos, places):
    """500 copies of the last frame, in which the block's bit is set."""
    demo = jax.tree.map(lambda x: x[0], demos)
    active = jnp.array([False, True, True, False, False])

    @jax.jit
    def draw(keys):
        one = lambda key: pretrain_contrast.displaced(  # noqa: E731
            key, jnp.asarray(LAST), demo.size[-1], active, demo, places, EXTENT
        )
        return jax.vmap(one)(keys)

    return jax.tree.map(np.asarray, draw(jax.random.split(jax.random.key(0), 500)))


def test_robot_and_padding_stay(made):
    np.testing.assert_array_equal(made.center[:, [1, 4]], np.tile(LAST[[1, 4]], (500, 1, 1)))
    assert not made.moved[:, [1, 4]].any()


def test_every_other_object_is_displaced_in_some_copies_and_not_in_others(made):
    offset = np.linalg.norm(made.center - LAST, axis=2)
    share = (offset[:, [0, 2, 3]] > 0).mean(axis=0)
    assert (share > 0.3).all()
    assert (share < 0.7).all()
    assert np.abs(made.center).max() <= EXTENT
    assert (offset[~made.moved] == 0).all()


def test_what_was_displaced_has_moved_and_some_has_been_touched_besides(made):
    assert made.active[made.moved].all()
    assert made.active[:, [1, 2]].all()
    assert 0.05 < made.active[:, 3][~made.moved[:, 3]].mean() < 0.4


def test_some_copies_are_close_to_the_reference_on_all_sides(made):
    offset = made.center[:, 2] - made.center[:, 0]
    close = (np.abs(offset) < 0.2).all(axis=1) & made.moved[:, 2]
    for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        assert (close & (offset * sign > 0).all(axis=1)).any()


def _contrast(params, demos, places, config=CONFIG, **hyper):
    active = jnp.zeros(demos.center.shape[:3], bool)
    return pretrain_contrast.contrast(
        params, jax.random.key(3), demos, active, places, Hyper(**hyper), config
    )


@pytest.fixture(scope="module")
def params():
    return encoder.init(jax.random.key(0), CONFIG.encoder)


def test_descending_the_loss_makes_rewards_what_they_should_be(params, demos, places):
    @jax.jit
    def descend(params):
        def step(params, _):
            loss, slope = jax.value_and_grad(_contrast)(params, demos, places, span=1.0, tail=0.0)
            return jax.tree.map(lambda p, g: p - 0.02 * g, params, slope), loss

        return jax.lax.scan(step, params, length=150)

    params, losses = descend(params)
    assert np.isfinite(np.asarray(losses)).all()
    assert float(losses[-1]) < 0.5 * float(losses[0])
    still = jnp.zeros(demos.center.shape[:3], bool)
    learned = reward.from_demos(params, demos, CONFIG.encoder, active=still)
    assert float(learned.scale) == pytest.approx(1.0, abs=0.3)  # span 1


def test_the_loss_of_undisplaced_frames_is_plain_arithmetic(params, demos, places):
    """An encoder that tells nothing apart has latent distance 0: what is left is what is due."""
    blind = jax.tree.map(jnp.zeros_like, params)
    hyper = {"tail": 0.5, "near": 0.6, "touch": 0.1}
    config = dataclasses.replace(CONFIG, anchors=200, copies=1)
    found = float(_contrast(blind, demos, places, config, **hyper))
    counted = jnp.arange(5) < 4
    counted = counted.at[1].set(False)
    due = [
        float(
            misplacement(
                places, c, jnp.full((5, 2), 0.2), demos.label[0], counted, jnp.zeros(5, bool),
                near=0.6, touch=0.1, idle_cost=Hyper().idle_cost,
            )
        )
        for c in demos.center[0]
    ]  # fmt: skip
    plain = np.mean([d**2 * (1 + 0.5 * (d / 0.1) ** 2) for d in due])
    assert found > 0.9 * plain  # the copies add theirs
    assert max(due) == pytest.approx(1.1 * 0.9 + 0.1 * 0.1, abs=0.15)


def test_ascents_make_the_copies_harder(params, demos, places):
    climbing = dataclasses.replace(CONFIG, ascents=4)
    plain, harder = (
        np.mean([float(_contrast(params, demos, places, c, span=s)) for s in (1.0, 2.0)])
        for c in (CONFIG, climbing)
    )
    assert harder != plain
    slope = jax.grad(_contrast)(params, demos, places, climbing)
    assert all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(slope))
