"""Every form, similarity and option of cycle-consistency against plain loops, and at the edges."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import tcc_loops
from support.tcc_loops import video

from gril_jax.errors import ConfigError, GrilError, ShapeError
from gril_jax.losses import cycle_consistency, mean_consistency
from gril_jax.losses.cycle import FORMS, cycle_error

TIMES = np.arange(7, dtype=np.float32) / 7
STATIC = ("form", "similarity", "normalize")
cycles = jax.jit(cycle_consistency, static_argnames=STATIC)


@functools.partial(jax.jit, static_argnames=STATIC)
@functools.partial(jax.value_and_grad, argnums=(0, 1))
def summed(query, other, times, query_valid, other_valid, **options):
    return cycle_consistency(query, other, times, query_valid, other_valid, **options).sum()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("similarity", "normalize"), [("l2", None), ("l2", True), ("cosine", None), ("cosine", False)]
)
def test_each_form_equals_the_loop(form, similarity, normalize):
    unit = similarity == "cosine" if normalize is None else normalize
    query, other = video(0, 7), video(1, 5)
    for temperature in (0.3, 1.0):
        options = {"form": form, "similarity": similarity, "normalize": normalize}
        values = cycles(query, other, TIMES, temperature=temperature, **options)
        loop = tcc_loops.pair(query, other, TIMES, form, similarity, temperature, unit)
        np.testing.assert_allclose(values, loop, rtol=2e-5, atol=1e-6)
        if form in ("regression_mse", "regression_huber"):
            np.testing.assert_allclose(values, loop, rtol=0, atol=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_equals_the_loop_to_twelve_digits_in_float64(form):
    query, other = video(0, 7), video(1, 5)
    with jax.enable_x64(True):
        arrays = (jnp.asarray(x, jnp.float64) for x in (query, other, TIMES))
        values = cycles(*arrays, form=form, temperature=0.5)
        assert values.dtype == jnp.float64
        loop = tcc_loops.pair(query, other, TIMES, form, temperature=0.5)
        np.testing.assert_allclose(values, loop, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("form", FORMS)
def test_padding_that_holds_nan_changes_neither_values_nor_gradients(form):
    query, other = video(0, 7), video(1, 5)
    value, gradient = summed(query[:4], other[:3], TIMES[:4], None, None, form=form)
    query[4:], other[3:] = np.nan, np.nan
    times = np.where(np.arange(7) < 4, TIMES, np.nan).astype(np.float32)
    masks = jnp.arange(7) < 4, jnp.arange(5) < 3
    padded, padded_gradient = summed(query, other, times, *masks, form=form)
    np.testing.assert_allclose(padded, value, rtol=1e-5, atol=1e-6)
    for found, expected, count in zip(padded_gradient, gradient, (4, 3), strict=True):
        np.testing.assert_allclose(found[:count], expected, rtol=1e-3, atol=1e-5)
        assert (np.asarray(found[count:]) == 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_gradients_equal_finite_differences(form):
    with jax.enable_x64(True):
        query, other, along = (jnp.asarray(video(s, n), jnp.float64) for s, n in _THREE)
        times = jnp.asarray(TIMES, jnp.float64)

        def value(t):
            return cycles(query + t * along, other, times, form=form, temperature=0.5).sum()

        numeric = (value(1e-5) - value(-1e-5)) / 2e-5
        np.testing.assert_allclose(jax.grad(value)(0.0), numeric, rtol=1e-6)


_THREE = [(0, 7), (1, 5), (2, 7)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("similarity", ["l2", "cosine"])
def test_values_and_gradients_are_finite_whatever_comes_in(form, similarity):
    query, other = video(0, 7), video(1, 5)
    everything, nothing = (
        (jnp.ones(7, bool), jnp.ones(5, bool)),
        (jnp.zeros(7, bool), jnp.zeros(5, bool)),
    )
    huge = np.float32(3e38)
    half = (jnp.arange(7) < 4, jnp.arange(5) < 3)
    cases = [
        (query, other, nothing),
        (query, other, (everything[0], nothing[1])),
        (np.zeros_like(query), np.zeros_like(other), everything),
        (query, query[:5], everything),
        (huge * np.sign(query), huge * np.sign(other), everything),
        (np.full_like(query, huge), np.full_like(other, -huge), everything),
        (1e6 * query, 1e-6 * other, half),
        (1e-30 * query, 1e-30 * other, half),
    ]
    for query_, other_, masks in cases:
        for temperature in (1.0, 1e-4, 0.0):
            value, gradient = summed(
                query_, other_, TIMES, *masks, form=form, similarity=similarity,
                temperature=jnp.asarray(temperature, jnp.float32),
            )  # fmt: skip
            assert np.isfinite(value)
            assert all(np.isfinite(g).all() for g in gradient)


def test_a_video_of_one_frame_always_comes_home():
    for form in FORMS:
        value, gradient = summed(video(0, 1), video(1, 5), TIMES[:1], None, None, form=form)
        floor = 0.001 * np.log(1e-8) if form == "regression_mse_var" else 0.0
        np.testing.assert_allclose(value, floor, atol=1e-6)
        assert not np.any(gradient[0])


def test_padding_does_not_win_against_frames_that_are_far_away():
    query, other = 1e6 * video(0, 7), 1e6 * video(1, 5)
    half = (jnp.arange(7) < 4, jnp.arange(5) < 3)
    values = cycles(query, other, TIMES, *half)
    np.testing.assert_allclose(values[:4], cycles(query[:4], other[:3], TIMES[:4]), atol=1e-6)


def test_half_precision_is_lifted_to_single():
    query, other = (jnp.asarray(video(s, 7), jnp.bfloat16) for s in (0, 1))
    values = cycles(query, other, TIMES)
    single = cycles(query.astype(jnp.float32), other.astype(jnp.float32), TIMES)
    np.testing.assert_array_equal(values, single)


def test_huber_is_linear_beyond_delta_and_half_the_square_within():
    times, logits = jnp.array([0.0, 1.0]), jnp.array([[0.0, 100.0], [0.0, 100.0]])
    far, near = cycle_error(logits, times, form="regression_huber", huber_delta=0.25)
    np.testing.assert_allclose([far, near], [0.25 * (1.0 - 0.125), 0.0], atol=1e-6)
    wide = cycle_error(logits, times, form="regression_huber", huber_delta=2.0)
    np.testing.assert_allclose(wide, [0.5, 0.0], atol=1e-6)


def test_classification_without_smoothing_is_plain_cross_entropy():
    logits = jnp.asarray(np.random.default_rng(0).normal(size=(3, 5)), jnp.float32)
    home = jnp.array([4, 0, 2])
    times = jnp.asarray(TIMES[:5])
    values = cycle_error(logits, times, home, form="classification", label_smoothing=0.0)
    expected = -jax.nn.log_softmax(logits)[jnp.arange(3), home]
    np.testing.assert_allclose(values, expected, rtol=1e-6)


def test_raw_indices_are_times_in_frames():
    query, other = video(0, 7), video(1, 5)
    shares = cycles(query, other, TIMES)
    np.testing.assert_allclose(cycles(query, other, 7 * TIMES), 49 * shares, rtol=1e-4, atol=1e-6)


def test_vmap_equals_a_loop_and_jit_equals_plain():
    queries, others = (np.stack([video(s + k, 7) for s in range(3)]) for k in (0, 10))
    batched = jax.vmap(lambda q, o: cycles(q, o, TIMES))(queries, others)
    for values, query, other in zip(batched, queries, others, strict=True):
        np.testing.assert_allclose(values, cycles(query, other, TIMES), rtol=1e-5, atol=1e-7)
    plain = cycle_consistency(*(jnp.asarray(x) for x in (queries[0], others[0], TIMES)))
    np.testing.assert_allclose(batched[0], plain, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"temperature": 0.0}, ConfigError, "temperature is 0.0; it must be positive"),
        ({"temperature": float("nan")}, ConfigError, "temperature is nan"),
        ({"form": "mse"}, ConfigError, "form is 'mse'; it must be one of regression_mse"),
        ({"similarity": "dot"}, ConfigError, "similarity is 'dot'"),
        ({"form": "regression_huber", "huber_delta": -1.0}, ConfigError, "huber_delta is -1.0"),
        ({"other": np.zeros((5, 4))}, ShapeError, r"\(7, 6\) and other has shape \(5, 4\)"),
        ({"other": np.zeros((0, 6))}, ShapeError, "at least one frame"),
        ({"other": np.zeros(6)}, ShapeError, r"must be \(frames, D\)"),
        ({"times": np.zeros(5)}, ShapeError, r"times has shape \(5,\) but query has 7 frames"),
        ({"other_valid": np.ones(7, bool)}, ShapeError, r"other_valid has shape \(7,\) but other"),
    ],
)
def test_what_does_not_fit_is_named_when_the_function_is_traced(change, kind, words, unchecked):
    given = {"query": video(0, 7), "other": video(1, 5), "times": TIMES, **change}
    with pytest.raises(kind, match=words) as caught:
        cycle_consistency(
            **{k: jnp.asarray(x) if isinstance(x, np.ndarray) else x for k, x in given.items()}
        )
    assert isinstance(caught.value, GrilError)


@pytest.fixture
def unchecked():
    """Shapes as a user meets them, without the suite's checks of annotations."""
    import jaxtyping

    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


# --- Cycle-consistency against a plain loop, with padding, and at aligned and shuffled videos


@jax.jit
def mean_agreement(latents, times, valid, temperature=1.0):
    return mean_consistency(latents, times, valid, temperature=temperature)[1]


def test_well_separated_equal_videos_return_to_the_frame_they_came_from():
    video = 10 * jnp.eye(7)
    assert cycles(video, video, TIMES).max() < 1e-6


def test_a_constant_video_answers_with_no_time_at_all():
    values = cycles(video(0, 7), jnp.zeros((5, 6)), TIMES, temperature=1e6)
    np.testing.assert_allclose(values, (TIMES.mean() - TIMES) ** 2, rtol=1e-3, atol=1e-5)


def test_values_do_not_change_when_both_videos_move_together():
    query, other = video(0, 7), video(1, 5)
    shift = jnp.array([3.0, -2.0, 1.0, 0.0, 4.0, -4.0])
    np.testing.assert_allclose(
        cycles(query + shift, other + shift, TIMES),
        cycles(query, other, TIMES),
        rtol=1e-2,
        atol=1e-5,
    )


def _agreement(query, other, times, other_times, temperature):
    """Squared difference between each frame's time and its soft neighbour's."""
    scale = query.shape[1] * temperature
    found = []
    for frame, time in zip(np.asarray(query), times, strict=True):
        apart = np.array([-((frame - o) ** 2).sum() / scale for o in np.asarray(other)])
        found.append((tcc_loops.softmax(apart) @ np.asarray(other_times) - time) ** 2)
    return found


def test_a_scrambled_order_that_both_videos_share_closes_cycles_but_disagrees_on_time():
    video, scramble = 10 * jnp.eye(7), jnp.array([3, 5, 0, 6, 2, 4, 1])
    assert cycles(video, video[scramble], TIMES).max() < 1e-6
    times, valid = jnp.stack([TIMES, TIMES]), jnp.ones((2, 7), bool)
    assert mean_agreement(jnp.stack([video, video[scramble]]), times, valid) > 0.05
    assert mean_agreement(jnp.stack([video, video]), times, valid) < 1e-6


def test_means_over_pairs_equal_a_double_loop_over_videos_of_unequal_length():
    lengths = [7, 4, 2]
    latents = jnp.stack([video(seed, 7) for seed in range(3)])
    times = jnp.stack([jnp.arange(7) / n for n in lengths])
    valid = jnp.arange(7) < jnp.array(lengths)[:, None]
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    cycles, agreements = [], []
    for i, j in pairs:
        query, other = latents[i, : lengths[i]], latents[j, : lengths[j]]
        time, other_time = times[i, : lengths[i]], times[j, : lengths[j]]
        cycles.extend(tcc_loops.pair(query, other, time, temperature=0.3))
        agreements.extend(_agreement(query, other, time, other_time, 0.3))
    cycle, agreement = jax.jit(mean_consistency)(latents, times, valid, temperature=0.3)
    np.testing.assert_allclose(cycle, np.mean(cycles), rtol=1e-4)
    np.testing.assert_allclose(agreement, np.mean(agreements), rtol=1e-4)


def test_single_video_and_empty_padding_give_zero_with_finite_gradient():
    latents, times = jnp.asarray(video(0, 7))[None], jnp.asarray(TIMES)[None]
    assert mean_consistency(latents, times) == (0, 0)

    @jax.jit
    @jax.value_and_grad
    def summed(latents, times, valid):
        return sum(mean_consistency(latents, times, valid))

    pair, times = jnp.concatenate([latents, latents]), jnp.tile(TIMES, (2, 1))
    value, gradient = summed(pair, times, jnp.zeros((2, 7), bool))
    assert value == 0
    assert np.isfinite(gradient).all()
