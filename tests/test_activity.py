"""Activity bits: both forms against a plain loop of Eq. 4, and against each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import activity


def _oracle(center, size, tau, window):
    """Eq. 4 frame by frame, in float64."""
    center, size = np.asarray(center, np.float64), np.asarray(size, np.float64)
    num_frames, num_nodes, _ = center.shape
    active = np.zeros((num_frames, num_nodes), bool)
    for t in range(num_frames):
        for i in range(num_nodes):
            before = center[max(t - window, 0), i]
            moved = np.linalg.norm(center[t, i] - before) > tau * np.linalg.norm(size[t, i])
            active[t, i] = moved or (t > 0 and active[t - 1, i])
    return active


def _walk(seed, num_frames=30, num_nodes=6):
    """Objects that start to drift at different times, some hardly at all."""
    rng = np.random.default_rng(seed)
    speed = np.array([0.0, 0.001, 0.004, 0.01, 0.03, 0.1])[:num_nodes, None]
    steps = rng.normal(size=(num_frames, num_nodes, 2)) * speed
    steps[0] = 0
    size = np.full((num_frames, num_nodes, 2), 0.3)
    return jnp.asarray(steps.cumsum(0), jnp.float32), jnp.asarray(size, jnp.float32)


def _rollout(center, size, tau, window):
    memory = activity.init(center[0], window=window)
    bits = [memory.active]
    for t in range(1, len(center)):
        memory, active = activity.step(memory, center[t], size[t], tau=tau)
        bits.append(active)
    return jnp.stack(bits)


@pytest.mark.parametrize("window", [1, 3, 40])
@pytest.mark.parametrize("tau", [0.005, 0.1])
def test_both_forms_equal_the_loop(window, tau):
    center, size = _walk(window)
    expected = _oracle(center, size, tau, window)
    assert 0 < expected.mean() < 1
    whole = activity.trajectory(center, size, tau=tau, window=window)
    np.testing.assert_array_equal(whole, expected)
    np.testing.assert_array_equal(_rollout(center, size, tau, window), expected)


def test_an_object_that_returns_stays_active():
    x = jnp.array([0.0, 0.1, 0.0, 0.0, 0.0])
    center = jnp.stack([x, jnp.zeros(5)], axis=-1)[:, None]
    active = activity.trajectory(center, jnp.ones((5, 1, 2)), window=2)
    assert active[:, 0].tolist() == [False, True, True, True, True]


def test_slow_drift_is_seen_over_the_window_but_not_over_one_frame():
    center = jnp.linspace(0.0, 0.1, 50)[:, None, None] * jnp.ones((1, 1, 2))
    size = jnp.full((50, 1, 2), 1.0)
    assert not activity.trajectory(center, size, window=1).any()
    assert activity.trajectory(center, size, window=40).any()


def test_threshold_is_relative_to_the_objects_own_box():
    center = jnp.zeros((2, 2, 2)).at[1, :, 0].set(0.01)
    size = jnp.broadcast_to(jnp.array([[0.3, 0.4], [3.0, 4.0]]), (2, 2, 2))
    active = activity.trajectory(center, size)  # diagonals 0.5 and 5: thresholds 0.0025, 0.025
    assert active[1].tolist() == [True, False]


def test_nothing_is_active_in_the_first_frame():
    center, size = _walk(0)
    assert not activity.trajectory(center, size)[0].any()
    assert not activity.init(center[0]).active.any()


def test_new_memory_forgets_the_last_episode():
    center, size = _walk(0)
    assert _rollout(center, size, 0.005, 4)[-1].any()
    memory = activity.init(center[-1], window=4)
    _, active = activity.step(memory, center[-1], size[-1])
    assert not active.any()


def test_one_frame_makes_one_row_of_idle_bits():
    active = activity.trajectory(jnp.ones((1, 3, 2)), jnp.ones((1, 3, 2)))
    assert active.tolist() == [[False] * 3]


def test_jitted_scan_and_vmapped_rollouts_equal_the_recording():
    walks = [_walk(seed) for seed in range(3)]
    center, size = (jnp.stack(x) for x in zip(*walks, strict=True))

    def rollout(center, size):
        def step(memory, frame):
            return activity.step(memory, *frame)

        return jax.lax.scan(step, activity.init(center[0], window=7), (center[1:], size[1:]))[1]

    bits = jax.jit(jax.vmap(rollout))(center, size)
    for i, walk in enumerate(walks):
        np.testing.assert_array_equal(bits[i], activity.trajectory(*walk, window=7)[1:])


def test_larger_tau_never_sets_more_bits_and_tau_can_be_vmapped():
    center, size = _walk(1)
    bits = jax.vmap(lambda tau: activity.trajectory(center, size, tau=tau, window=5))(
        jnp.array([0.0, 0.005, 0.05, 0.5])
    )
    assert (bits[:-1] >= bits[1:]).all()
    assert bits[0].sum() > bits[-1].sum()
