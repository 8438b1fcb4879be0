"""States on a grid."""

import jax
import jax.numpy as jnp
import numpy as np
from support.audit_tasks import SIZE, START, one_shoe, packing, start

from gril_jax.audit.scene_reward import alone, grid, pushed


def test_rows_go_up_and_columns_to_the_right():
    places = grid(2.0, 3)
    np.testing.assert_allclose(places[0, 0], [-2, -2])
    np.testing.assert_allclose(places[0, 2], [2, -2])
    np.testing.assert_allclose(places[2, 0], [-2, 2])


def test_each_object_alone_goes_from_wall_to_wall():
    task, center = one_shoe(), START.at[3].set(0.0)
    scenes = alone(task, start(), center, side=3)
    assert scenes.center.shape == (5, 3, 3, 5, 2)
    for m, index in enumerate((1, 2, 3, 4, 0)):
        np.testing.assert_allclose(scenes.center[m, 0, 2, index], [0.9, -0.9], atol=1e-6)
        rest = np.delete(np.arange(5), index)
        np.testing.assert_array_equal(scenes.center[m, 1, 1, rest], center[rest])
        assert scenes.active[m, 0, 0, index]
        assert scenes.active[m, 0, 0, 3]  # it is not where it began
    assert scenes.size.shape == scenes.center.shape


def test_all_targets_are_pushed_side_by_side_to_places_where_nothing_is_done():
    scenes, free = pushed(packing(), start(), side=5)
    targets = jnp.array([1, 2, 3])
    np.testing.assert_allclose(
        scenes.center[2, 2, targets], [[-0.2, 0], [0, 0], [0.2, 0]], atol=1e-6
    )
    assert (jnp.abs(scenes.center[:, :, targets]) <= 0.9 + 1e-6).all()
    np.testing.assert_array_equal(scenes.center[1, 1, 4], START[4])
    task = packing()
    progress = jax.vmap(jax.vmap(lambda c: task.progress(c, SIZE)))(scenes.center)
    np.testing.assert_array_equal(free, progress <= 0)
    assert free.any()
    assert not free.all()
