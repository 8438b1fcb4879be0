"""Frames with objects displaced: what may be moved, and what the loss makes of it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import reward
from gril_jax.audit.scene_reward import Scene
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.pretraining import batch, contrast
from gril_jax.pretraining.final_places import final_places, misplacement
from gril_jax.pretraining.options import Hyper, Static
from gril_jax.types import DemoBatch

# Region, robot, a block that the video moves, one that it does not, and padding.
FIRST = np.array([[0.5, 0.5], [-0.9, 0.0], [-0.5, 0.0], [0.0, -0.6], [0.0, 0.0]], np.float32)
LAST = np.array([[0.5, 0.5], [0.3, 0.4], [0.5, 0.6], [0.0, -0.6], [0.0, 0.0]], np.float32)
EXTENT = 1.1
FRAMES = 6
CONFIG = Static(
    EncoderConfig(4, width=8, rounds=1, latent=4), num_perturbations=3, perturbed_frames=4
)


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
        one = lambda key: batch.displaced(  # noqa: E731
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


def test_where_ends_are_places_a_copy_holds_the_same_things(demos, places):
    demo = jax.tree.map(lambda x: x[0], demos)
    label, there = batch.other_things(jax.random.key(0), demo, places)
    np.testing.assert_array_equal(label, demo.label)
    np.testing.assert_array_equal(there, demo.present)


def _contrast(params, demos, places, config=CONFIG, pool=None, **hyper):
    active = jnp.zeros(demos.center.shape[:3], bool)
    return contrast.contrast(
        params, jax.random.key(3), demos, active, places, Hyper(**hyper), config, pool
    )


_compiled = jax.jit(_contrast)
_misplaced = jax.jit(misplacement)


@pytest.fixture(scope="module")
def params():
    return encoder.init(jax.random.key(0), CONFIG.encoder)


def test_descending_the_loss_makes_rewards_what_they_should_be(params, demos, places):
    @jax.jit
    def descend(params):
        def step(params, _):
            loss, slope = jax.value_and_grad(_contrast)(
                params, demos, places, latent_scale=1.0, quartic_weight=0.0
            )
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
    hyper = {"quartic_weight": 0.5, "near_cost_fraction": 0.6, "touch": 0.1}
    config = dataclasses.replace(CONFIG, perturbed_frames=200, num_perturbations=1)
    found = float(_compiled(blind, demos, places, config, **hyper))
    counted = jnp.arange(5) < 4
    counted = counted.at[1].set(False)
    due = [
        float(
            _misplaced(
                places, c, jnp.full((5, 2), 0.2), demos.label[0], counted, jnp.zeros(5, bool),
                near_cost_fraction=0.6, touch=0.1, intrusion_weight=Hyper().intrusion_weight,
            )
        )
        for c in demos.center[0]
    ]  # fmt: skip
    plain = np.mean([d**2 * (1 + 0.5 * (d / 0.1) ** 2) for d in due])
    assert found > 0.9 * plain  # the copies add theirs
    assert max(due) == pytest.approx(1.1 * 0.9 + 0.1 * 0.1, abs=0.15)


def test_ascents_go_where_copies_are_overestimated(params, demos, places):
    """An encoder that tells nothing apart overestimates most what is furthest out of place."""
    blind = jax.tree.map(jnp.zeros_like, params)
    climbing = dataclasses.replace(CONFIG, adversarial_steps=1)
    plain = float(_compiled(blind, demos, places, CONFIG, quartic_weight=0.0))
    harder, slope = jax.jit(jax.value_and_grad(_contrast))(
        blind, demos, places, climbing, quartic_weight=0.0
    )
    assert float(harder) > 1.02 * plain
    assert all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(slope))


# --- a pool of scenes

HYPER = {"quartic_weight": 0.5, "near_cost_fraction": 0.6, "touch": 0.1}


def _pool(*centers):
    """Scenes without padding, in which the block has been moved."""
    shape = (len(centers), 4)
    label = jnp.broadcast_to(jnp.arange(4), shape)
    center = jnp.asarray(np.stack(centers)[:, :4], jnp.float32)
    return Scene(center, jnp.full((*shape, 2), 0.2), label, label == 1, label == 2)


def _due(scene, places):
    return float(
        _misplaced(
            places, scene.center, scene.size, scene.label, ~scene.is_robot, scene.active,
            near_cost_fraction=0.6, touch=0.1, intrusion_weight=Hyper().intrusion_weight,
        )
    )  # fmt: skip


@pytest.mark.slow
def test_a_pool_adds_the_mean_error_of_its_scenes(params, demos, places):
    """By an encoder that tells nothing apart, whose error is what is due."""
    blind = jax.tree.map(jnp.zeros_like, params)
    config = dataclasses.replace(CONFIG, num_perturbations=1, perturbed_frames=100)
    pool = _pool(FIRST, LAST)
    without, both = (
        float(_compiled(blind, demos, places, config, pool=p, **HYPER)) for p in (None, pool)
    )
    due = [_due(jax.tree.map(lambda x: x[i], pool), places) for i in range(2)]  # noqa: B023
    assert due[0] > 0.5
    assert due[1] == pytest.approx(0.0, abs=1e-6)
    wanted = np.mean([d**2 * (1 + 0.5 * (d / 0.1) ** 2) for d in due])
    assert both - without == pytest.approx(wanted, rel=0.2)  # 300 are drawn, either as often


@pytest.mark.slow
def test_scenes_of_a_pool_are_turned_where_videos_are(params, demos):
    """Their cost is that of a symmetric box, whichever way they are turned; their latent is not."""
    symmetric = final_places(demos, 4, turned=True)
    still = dataclasses.replace(CONFIG, num_perturbations=0)
    turning = dataclasses.replace(still, turn_scenes=True)
    blind = jax.tree.map(jnp.zeros_like, params)
    (blind_still, still), (blind_turned, turned) = (
        [float(_compiled(p, demos, symmetric, c, _pool(FIRST), **HYPER)) for p in (blind, params)]
        for c in (still, turning)
    )
    assert blind_turned == pytest.approx(blind_still, rel=1e-4)
    assert turned != pytest.approx(still, rel=1e-4)


@pytest.mark.slow
def test_the_gradient_of_a_pool_is_that_of_finite_differences(params, demos, places):
    alone = dataclasses.replace(CONFIG, num_perturbations=0)
    # Away from where fresh biases are 0, which is a kink of the activations.
    keys = iter(jax.random.split(jax.random.key(5), 100))
    params = jax.tree.map(lambda p: p + 0.1 * jax.random.normal(next(keys), p.shape), params)

    @jax.jit
    def both(params):
        loss = lambda p: _contrast(p, demos, places, alone, pool=_pool(FIRST), quartic_weight=0.0)  # noqa: E731
        return jax.value_and_grad(loss)(params)

    slope = both(params)[1]
    size = jnp.sqrt(sum(jnp.sum(x**2) for x in jax.tree.leaves(slope)))
    ahead, behind = (
        float(both(jax.tree.map(lambda p, g: p + step * g / size, params, slope))[0])  # noqa: B023
        for step in (1e-2, -1e-2)
    )
    assert (ahead - behind) / 2e-2 == pytest.approx(float(size), rel=1e-2)
