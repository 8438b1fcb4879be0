"""Activity bits: both forms against a plain loop of Eq. 4, and against each other."""

import functools
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import activity

STATIC = ("window", "smoothing")
trajectory = jax.jit(activity.trajectory, static_argnames=STATIC)


def _oracle(center, size, tau, window, smoothing=1, noise=None):
    """Eq. 4 and its options frame by frame, in float64."""
    center, size = np.asarray(center, np.float64), np.asarray(size, np.float64)
    num_frames, num_nodes, _ = center.shape
    active = np.zeros((num_frames, num_nodes), bool)
    first = smoothing - 1  # the first frame of which there is a whole median
    spread = np.sqrt(np.pi / (smoothing + np.pi / 2 - 1))
    for i in range(num_nodes):
        seen = np.concatenate([center[:1, i]] * first + [center[:, i]])
        smooth = [np.median(seen[t : t + smoothing], axis=0) for t in range(num_frames)]
        for t in range(num_frames):
            threshold = tau * np.linalg.norm(size[t, i])
            if noise is not None:
                threshold = max(threshold, 5 * noise * spread)
            moved = np.linalg.norm(smooth[t] - smooth[min(max(t - window, first), t)]) > threshold
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


@functools.partial(jax.jit, static_argnames=STATIC)
def _rollout(center, size, tau, window, smoothing=1, **options):
    memory = activity.init(center[0], window=window, smoothing=smoothing)

    def step(memory, frame):
        return activity.step(memory, *frame, tau=tau, **options)

    _, bits = jax.lax.scan(step, memory, (center[1:], size[1:]))
    return jnp.concatenate([memory.active[None], bits])


@pytest.mark.parametrize("window", [1, 3, 40])
@pytest.mark.parametrize("tau", [0.005, 0.1])
def test_both_forms_equal_the_loop(window, tau):
    center, size = _walk(window)
    expected = _oracle(center, size, tau, window)
    assert 0 < expected.mean() < 1
    whole = trajectory(center, size, tau=tau, window=window)
    np.testing.assert_array_equal(whole, expected)
    np.testing.assert_array_equal(_rollout(center, size, tau, window), expected)


OPTIONS = [{"noise": 0.01}, {"smoothing": 3}, {"smoothing": 5, "noise": 0.01}]


def test_both_forms_equal_the_loop_with_every_option():
    for number, options in enumerate(OPTIONS):
        window = (2, 7, 4)[number % 3]
        center, size = _walk(number)
        expected = _oracle(center, size, 0.02, window, **options)
        whole = trajectory(center, size, tau=0.02, window=window, **options)
        np.testing.assert_array_equal(whole, expected, str(options))
        np.testing.assert_array_equal(_rollout(center, size, 0.02, window, **options), expected)
        assert 0 < expected.mean() < 1


def _jittered(seed, num_objects, num_frames=120, pixel=2.2 / 384):
    """Boxes of 50 pixels at rest; centres jitter by 0.35 pixels along each axis."""
    rng = np.random.default_rng(seed)
    center = 0.35 * pixel * rng.normal(size=(num_frames, num_objects, 2))
    size = np.full((num_frames, num_objects, 2), 50 * pixel)
    return jnp.asarray(center, jnp.float32), jnp.asarray(size, jnp.float32), pixel


def test_jitter_sets_every_bit_but_not_with_smoothing_and_noise():
    center, size, pixel = _jittered(0, 4000)
    assert trajectory(center, size)[-1].all()
    for smoothing in (1, 3, 5):
        active = trajectory(center, size, smoothing=smoothing, noise=0.35 * pixel)
        assert active[-1].mean() < 0.002


def test_single_frames_far_off_do_not_pass_a_median():
    center, size, pixel = _jittered(1, 1000)
    off = jnp.asarray(np.random.default_rng(1).random((120, 1000, 1)) < 0.002)
    center = center + jnp.where(off, 30 * pixel, 0.0)
    plain = trajectory(center, size, noise=0.35 * pixel)
    smooth = trajectory(center, size, smoothing=5, noise=0.35 * pixel)
    assert plain[-1].mean() > 0.15
    assert smooth[-1].mean() < 0.005


@pytest.mark.parametrize(("speed", "delay"), [(0.5, 6), (1.0, 5), (3.0, 3)])
def test_a_push_in_jitter_is_seen_after_a_few_frames(speed, delay):
    center, size, pixel = _jittered(2, 500)
    path = speed * pixel * np.clip(np.arange(120) - 59, 0, 8)
    center = center.at[:, :, 0].add(path[:, None])
    active = np.asarray(trajectory(center, size, smoothing=5, noise=0.35 * pixel))
    assert active[-1].all()
    assert np.median(active.argmax(axis=0)) - 59 <= delay


def test_a_whole_number_of_equal_frames_is_never_active_whatever_the_options():
    center, size = jnp.full((9, 1, 2), 0.1), jnp.ones((9, 1, 2))
    for options in OPTIONS:
        assert not trajectory(center, size, tau=0.0, window=2, **options).any()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"window": 0}, "window is 0"),
        ({"smoothing": 4}, "smoothing is 4; it must be an odd"),
        ({"smoothing": -1}, "smoothing is -1"),
        ({"tau": -0.1}, "tau is -0.1"),
        ({"noise": float("nan")}, "noise is nan"),
    ],
)
def test_options_out_of_range_are_refused(options, text):
    center, size = _walk(0)
    with pytest.raises(ConfigError, match=text):
        activity.trajectory(center, size, **options)
    if {"window", "smoothing"} & set(options):
        with pytest.raises(ConfigError, match=text):
            activity.init(center[0], **options)
    else:
        with pytest.raises(ConfigError, match=text):
            activity.step(activity.init(center[0]), center[1], size[1], **options)


def test_boxes_that_do_not_fit_are_refused():
    center, size = _walk(0)
    trajectory, step = inspect.unwrap(activity.trajectory), inspect.unwrap(activity.step)
    with pytest.raises(ShapeError, match=r"size has shape \(30, 5, 2\); both must be \(30, 6, 2"):
        trajectory(center, size[:, :5])
    with pytest.raises(ShapeError, match=r"center has shape \(5, 2\)"):
        step(activity.init(center[0]), center[0, :5], size[0, :5])


def test_new_memory_forgets_the_last_episode():
    center, size = _walk(0)
    assert _rollout(center, size, 0.005, 4)[-1].any()
    memory = activity.init(center[-1], window=4)
    _, active = activity.step(memory, center[-1], size[-1])
    assert not active.any()


def test_one_frame_makes_one_row_of_idle_bits():
    active = trajectory(jnp.ones((1, 3, 2)), jnp.ones((1, 3, 2)))
    assert active.tolist() == [[False] * 3]


def test_larger_tau_never_sets_more_bits_and_tau_can_be_vmapped():
    center, size = _walk(1)
    bits = jax.vmap(lambda tau: trajectory(center, size, tau=tau, window=5))(
        jnp.array([0.0, 0.005, 0.05, 0.5])
    )
    assert (bits[:-1] >= bits[1:]).all()
    assert bits[0].sum() > bits[-1].sum()
