"""Where demonstrations leave things: the reference is found, and distances are a loop's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.final_places import final_places, out_of_place
from gril_jax.types import DemoBatch

REGION, ROBOT, BLOCK, IDLE, ABSENT = range(5)  # classes; the last is in no video
HALF = np.array([0.35, 0.25])  # of the region


@pytest.fixture(scope="module")
def demos():
    """In 24 videos a block goes into the region, which stands anywhere; another stays put."""
    rng = np.random.default_rng(0)
    num = 24
    first = rng.uniform(-0.9, 0.9, (num, 4, 2))
    last = first.copy()
    last[:, BLOCK] = last[:, REGION] + rng.uniform(-0.8, 0.8, (num, 2)) * HALF
    last[:, ROBOT] = rng.uniform(-0.9, 0.9, (num, 2))
    size = np.full((num, 4, 2), 0.2)
    size[:, REGION] = 2 * HALF
    frames = np.stack([first, last, last], axis=1)  # the third is padding
    return DemoBatch(
        center=jnp.asarray(frames, jnp.float32),
        size=jnp.asarray(np.repeat(size[:, None], 3, axis=1), jnp.float32),
        label=jnp.tile(jnp.arange(4), (num, 1)),
        is_robot=jnp.tile(jnp.arange(4) == ROBOT, (num, 1)),
        present=jnp.ones((num, 4), bool),
        length=jnp.full(num, 2),
    )


@pytest.fixture(scope="module")
def places(demos):
    return jax.jit(lambda d: final_places(d, 5))(demos)


def test_the_reference_is_what_a_moved_object_has_a_fixed_relation_to(places):
    assert int(places.reference[BLOCK]) == REGION
    assert not places.known[ABSENT].any()


def test_what_moves_is_no_reference(places):
    assert BLOCK not in [int(places.reference[c]) for c in (REGION, IDLE)]


def test_a_demonstrations_own_last_frame_is_in_place(demos, places):
    astray = jax.vmap(lambda c, s, n: out_of_place(places, c, s, n))(
        demos.center[:, 1], demos.size[:, 1], demos.label
    )
    np.testing.assert_allclose(astray[:, [BLOCK, IDLE]], 0, atol=1e-6)


def test_the_distance_is_that_of_a_loop_over_all_places(demos, places):
    rng = np.random.default_rng(1)
    size = np.asarray(demos.size[0, 0], np.float64)
    size[REGION] = [0.5, 0.9]  # places scale with the reference's box
    last, label = np.asarray(demos.center[:, 1], np.float64), jnp.arange(4)
    for _ in range(5):
        center = rng.uniform(-1, 1, (4, 2))
        found = out_of_place(
            places, jnp.asarray(center, jnp.float32), jnp.asarray(size, jnp.float32), label
        )
        offsets = (last[:, BLOCK] - last[:, REGION]) / (2 * HALF)
        away = center[BLOCK] - center[REGION] - offsets * size[REGION]
        expected = np.linalg.norm(away, axis=1).min()
        assert float(found[BLOCK]) == pytest.approx(expected, abs=1e-5)


def test_turned_scenes_know_the_eight_images_of_each_place(demos):
    turned = final_places(demos, 5, turned=True)
    plain = final_places(demos, 5)
    assert turned.offset.shape[1] == 8 * plain.offset.shape[1]
    images = {tuple(np.round(o, 5)) for o in np.asarray(turned.offset[BLOCK])}
    for x, y in np.asarray(plain.offset[BLOCK])[:5]:
        for a, b in ((x, y), (y, x)):
            for i in (1, -1):
                for j in (1, -1):
                    near = np.array([i * a, j * b])
                    assert min(np.abs(np.array(o) - near).max() for o in images) < 1e-4


def test_a_scene_without_the_reference_has_nothing_out_of_place(places):
    label = jnp.array([ABSENT, BLOCK])
    found = out_of_place(places, jnp.ones((2, 2)), jnp.ones((2, 2)), label)
    np.testing.assert_array_equal(found, 0)
