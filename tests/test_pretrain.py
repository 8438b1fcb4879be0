"""Encoder training on made-up demonstrations: blocks carried to a region, one after another."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import activity, encoder, pretrain, reward
from gril_jax.encoder import EncoderConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs import scene_graph
from gril_jax.pretrain import Hyper, PretrainConfig
from gril_jax.types import DemoBatch

GOAL, ROBOT, STAR, SQUARE = range(4)  # further labels are distractors
SIZES = np.array([[0.6, 0.7], [0.6, 0.6], *[[0.28, 0.28]] * 5])


def kinematic_demos(seed, num_demos, *, num_objects=7, max_length=120, jitter=None):
    """Blocks dragged along straight lines with wobble, in random order, then let go.

    Layouts are random, or with `jitter` one fixed layout moved by at most that much.
    """
    rng = np.random.default_rng(seed)
    center = np.zeros((num_demos, max_length, num_objects, 2), np.float32)
    length = np.zeros(num_demos, np.int32)
    for b in range(num_demos):
        frames = _one_demo(rng, _layout(rng, num_objects, jitter), num_objects)[:max_length]
        length[b] = len(frames)
        center[b, : len(frames)] = frames
        center[b, len(frames) :] = frames[-1]

    def tile(x):
        return np.broadcast_to(x, (num_demos, *np.shape(x)))

    return DemoBatch(
        center=center,
        size=np.tile(SIZES[:num_objects], (num_demos, max_length, 1, 1)).astype(np.float32),
        label=tile(np.arange(num_objects, dtype=np.int32)),
        is_robot=tile(np.arange(num_objects) == ROBOT),
        present=tile(np.ones(num_objects, bool)),
        length=length,
    )


def _layout(rng, num_objects, jitter):
    if jitter is not None:
        fixed = [(0.4, 0.35), (-0.5, 0.1), (0.8, -0.7), (-0.68, 0.72)]
        fixed += [(-0.05, -0.2), (-0.75, -0.55), (0.3, -0.82)]
        return np.array(fixed)[:num_objects] + rng.uniform(-jitter, jitter, (num_objects, 2))
    goal = rng.uniform(-0.7, 0.7, 2)
    places = [goal]
    while len(places) < num_objects:
        place = rng.uniform(-0.95, 0.95, 2)
        if (np.abs(place - goal) > [0.45, 0.5]).any():  # nothing begins in the region
            places.append(place)
    return np.array(places)


def _one_demo(rng, place, num_objects):
    frames, place = [place.copy()], place.copy()

    def travel(moving, target, speed):  # world units per frame
        distance = np.linalg.norm(target - place[moving[0]])
        steps = max(2, int(distance / (speed * rng.uniform(0.75, 1.25))))
        start = place[moving].copy()
        for share in np.linspace(0, 1, steps + 1)[1:]:
            wobble = rng.normal(0, 0.01, 2) * (share < 1)
            place[moving] = start + share * (target - start[0]) + wobble
            frames.append(place.copy())

    for slot, block in enumerate(rng.permutation([STAR, SQUARE])):
        travel([ROBOT], place[block] + rng.normal(0, 0.02, 2), 0.08)
        if num_objects > 4 and rng.random() < 0.25:  # a distractor is bumped on the way
            bumped = rng.integers(4, num_objects)
            place[bumped] += rng.normal(0, 0.05, 2)
            frames.append(place.copy())
        place[ROBOT] = place[block]
        spot = place[GOAL] + [0.0, (-0.15, 0.15)[slot]] + rng.uniform(-0.08, 0.08, 2)
        travel([block, ROBOT], spot, 0.045)
    return np.array(frames, np.float32)


SMALL = PretrainConfig(
    encoder=EncoderConfig(num_classes=7, width=8, rounds=1, latent=4),
    updates=3,
    num_videos=3,
    num_frames=6,
)


@pytest.fixture(scope="module")
def demos():
    return jax.tree.map(jnp.asarray, kinematic_demos(0, 5, num_objects=5))


@pytest.fixture(scope="module")
def state(demos):
    return pretrain.init(jax.random.key(0), demos, SMALL)


@pytest.fixture(scope="module")
def stepped(state, demos):
    return pretrain.step(state, demos, Hyper(), SMALL)


def test_held_out_demonstrations_are_ordered_after_a_short_training():
    train, held_out = (
        jax.tree.map(jnp.asarray, kinematic_demos(seed, n, num_objects=4))
        for seed, n in ((0, 60), (1, 10))
    )
    config = PretrainConfig(encoder=EncoderConfig(num_classes=4), updates=300, num_frames=24)
    state = pretrain.init(jax.random.key(0), train, config)
    before = pretrain.evaluate(state.params.encoder, held_out, train, Hyper(), config)
    state, metrics = pretrain.step(state, train, Hyper(), config)
    after = pretrain.evaluate(state.params.encoder, held_out, train, Hyper(), config)
    assert after["tau"] > 0.8 > before["tau"]
    assert after["reward_time_tau"] > 0.7
    np.testing.assert_allclose(after["reward_first"], -1.0, atol=0.15)
    assert after["reward_last"] > -0.25
    assert metrics.cycle[-20:].mean() < 0.5 * metrics.cycle[:5].mean()
    assert metrics.reconstruction[-20:].mean() < 0.1 * metrics.reconstruction[:5].mean()


def test_step_returns_one_value_per_update_and_counts_them(state, stepped):
    after, metrics = stepped
    assert {x.shape for x in metrics} == {(3,)}
    assert all(np.isfinite(x).all() for x in metrics)
    assert after.num_updates == 3
    assert (metrics.loss > metrics.cycle + metrics.reconstruction).all()  # time agreement
    changed = jax.tree.map(lambda a, b: bool((a != b).any()), state.params, after.params)
    assert all(jax.tree.leaves(changed))


def test_after_the_warmup_the_loss_is_equation_6_alone(state, demos):
    hyper = Hyper(lambda_=0.5, warmup=2.0)
    _, metrics = pretrain.step(state, demos, hyper, SMALL)
    agreement = metrics.loss - metrics.cycle - 0.5 * metrics.reconstruction
    assert agreement[0] > agreement[1] > 1e-3
    np.testing.assert_allclose(agreement[2], 0.0, atol=1e-6)
    _, metrics = pretrain.step(state, demos, hyper._replace(warmup=0.0), SMALL)
    expected = metrics.cycle + 0.5 * metrics.reconstruction
    np.testing.assert_allclose(metrics.loss, expected, rtol=1e-5)


def test_where_a_run_is_cut_into_chunks_changes_no_bit(state, stepped, demos):
    single = dataclasses.replace(SMALL, updates=1)
    for _ in range(3):
        state, _ = pretrain.step(state, demos, Hyper(), single)
    for a, b in zip(jax.tree.leaves(state.params), jax.tree.leaves(stepped[0].params), strict=True):
        np.testing.assert_array_equal(a, b)


def test_vmap_over_seeds_and_learning_rates_equals_single_runs(state, stepped, demos):
    keys = jnp.stack([jax.random.key(0), jax.random.key(0), jax.random.key(1)])
    states = jax.vmap(pretrain.init, (0, None, None))(keys, demos, SMALL)
    rates = jnp.array([1e-3, 1e-2, 1e-3])
    rate_only = Hyper(*[None] * len(Hyper._fields))._replace(learning_rate=0)
    many, metrics = jax.vmap(pretrain.step, (0, None, rate_only, None))(
        states, demos, Hyper(learning_rate=rates), SMALL
    )
    np.testing.assert_allclose(metrics.loss[0], stepped[1].loss, rtol=1e-3)
    np.testing.assert_allclose(metrics.loss[1, 0], metrics.loss[0, 0], rtol=1e-5)
    assert not np.allclose(metrics.loss[1, 2], metrics.loss[0, 2], rtol=1e-3)
    assert not np.allclose(metrics.loss[2], metrics.loss[0], rtol=1e-3)
    alone = jax.tree.leaves(stepped[0].params)
    for batched, one in zip(jax.tree.leaves(many.params), alone, strict=True):
        np.testing.assert_allclose(batched[0], one, rtol=1e-2, atol=1e-4)


def test_drawn_frames_are_distinct_sorted_and_from_distinct_videos():
    length = jnp.array([20, 4, 12, 1])
    config = dataclasses.replace(SMALL, num_videos=4)
    for seed in range(5):
        frames, valid, videos = pretrain._draw(jax.random.key(seed), length, 20, config)
        assert sorted(videos.tolist()) == [0, 1, 2, 3]
        for row, ok, video in zip(frames, valid, videos, strict=True):
            drawn = row[ok].tolist()
            assert drawn == sorted(set(drawn))
            assert len(drawn) == min(6, int(length[video]))
            assert max(drawn) < length[video]


def test_every_frame_is_drawn_in_time():
    length = jnp.array([8, 8])
    config = dataclasses.replace(SMALL, num_videos=2, num_frames=2)
    draw = jax.vmap(pretrain._draw, (0, None, None, None))
    frames, _, _ = draw(jax.random.split(jax.random.key(0), 200), length, 8, config)
    counts = np.bincount(np.asarray(frames).ravel(), minlength=8)
    assert counts.min() > 0.6 * counts.mean()


def test_embed_equals_the_encoder_frame_by_frame(state, demos):
    params = state.params.encoder
    latents = pretrain.embed(params, demos, Hyper(alpha=2.0), SMALL)
    for demo, frame in ((0, 0), (1, 30), (4, 70)):
        active = activity.trajectory(demos.center[demo], demos.size[demo])
        graph = scene_graph(
            demos.center[demo, frame],
            demos.size[demo, frame],
            demos.label[demo],
            demos.is_robot[demo],
            active[frame],
            demos.present[demo],
        )
        one = encoder.apply(params, graph, SMALL.encoder, alpha=2.0)
        np.testing.assert_allclose(latents[demo, frame], one, rtol=1e-4, atol=1e-5)


def test_evaluation_agrees_with_the_reward_of_the_training_demonstrations(state, demos):
    params = state.params.encoder
    values = pretrain.evaluate(params, demos, demos, Hyper(), SMALL)
    assert set(values) == {"tau", "reward_time_tau", "reward_first", "reward_last"}
    np.testing.assert_allclose(values["reward_first"], -1.0, rtol=1e-4)
    learned = reward.from_demos(params, demos, SMALL.encoder)
    latents = pretrain.embed(params, demos, Hyper(), SMALL)
    last = [z[int(n) - 1] for z, n in zip(latents, demos.length, strict=True)]
    expected = -learned.scale * np.mean([np.linalg.norm(z - learned.goal) for z in last])
    np.testing.assert_allclose(values["reward_last"], expected, rtol=1e-3)


def test_frames_after_the_length_do_not_enter_the_loss(state, stepped, demos):
    padding = jnp.arange(demos.center.shape[1]) >= demos.length[:, None]
    moved = jnp.where(padding[:, :, None, None], 50.0, demos.center)
    _, metrics = pretrain.step(state, demos._replace(center=moved), Hyper(), SMALL)
    np.testing.assert_array_equal(metrics.loss, stepped[1].loss)


def test_more_videos_in_a_batch_than_demonstrations_is_refused(demos):
    config = dataclasses.replace(SMALL, num_videos=6)
    with pytest.raises(ConfigError, match="num_videos is 6 but there are 5 demonstrations"):
        pretrain.init(jax.random.key(0), demos, config)


@pytest.mark.parametrize(
    ("field", "value"), [("updates", 0), ("num_videos", 1), ("num_frames", 1), ("window", 0)]
)
def test_config_out_of_range_is_refused_by_name(field, value):
    with pytest.raises(ConfigError, match=rf"pretrain\.{field} is {value}"):
        dataclasses.replace(SMALL, **{field: value})


def test_turned_scenes_keep_all_distances_and_swap_boxes_with_axes(demos):
    turned = pretrain._turned(jax.random.key(3), demos)
    apart = [
        jnp.linalg.norm(d.center[:, :, :, None] - d.center[:, :, None], axis=-1)
        for d in (demos, turned)
    ]
    np.testing.assert_allclose(*apart, atol=1e-5)
    from_middle = [jnp.linalg.norm(d.center, axis=-1) for d in (demos, turned)]
    np.testing.assert_allclose(*from_middle, atol=1e-5)
    np.testing.assert_allclose(
        jnp.sort(demos.size, axis=-1), jnp.sort(turned.size, axis=-1), atol=1e-6
    )
    swapped = (turned.size != demos.size).any(axis=(1, 2, 3))
    wide = jnp.abs(jnp.abs(turned.center) - jnp.abs(demos.center)).max(axis=(1, 2, 3)) > 1e-4
    assert 0 < int(wide.sum()) < len(wide)  # some videos have their axes swapped, some not
    assert not bool((swapped & ~wide).any())


def test_turning_and_touching_change_the_batches_and_nothing_is_nan(demos):
    losses = {}
    changes = {"plain": {}, "turn": {"turn_scenes": True}, "touch": {"touched": 0.5}}
    for name, change in changes.items():
        fresh = pretrain.init(jax.random.key(0), demos, SMALL)
        _, metrics = pretrain.step(fresh, demos, Hyper(), dataclasses.replace(SMALL, **change))
        losses[name] = np.asarray(metrics.loss)
        assert np.isfinite(losses[name]).all()
    assert not np.allclose(losses["plain"], losses["turn"])
    assert not np.allclose(losses["plain"], losses["touch"])
