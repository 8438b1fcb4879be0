"""Measures of a stage's reward: of rewards that know the truth, know nothing, or lie."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.stages import put_inside
from gril_jax.experiments.stage_rewards import measures, segments, ways
from support.kinematic_demos import GOAL, ROBOT, SQUARE, STAR, kinematic_demos

from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.graphs import activity
from gril_jax.pretraining.final_places import final_places
from gril_jax.reward.latent_goal import RewardParams

TASK = put_inside((STAR, SQUARE), GOAL, robots=(ROBOT,), half_extent=1.0)
NOT_ASKED = ways.StageReward(
    RewardParams({}, jnp.zeros(1), jnp.ones(()), jnp.ones(())), jnp.zeros(())
)


@functools.cache
def _parts():
    """Segments until one block is inside, and until both are."""
    films = jax.device_put(kinematic_demos(0, 6))
    bits = jax.vmap(activity.trajectory)(films.center, films.size)
    return films, segments.cut(films, bits, segments.true_ends(TASK, films, jnp.arange(7)))


def _measured(monkeypatch, pay, number, width):
    """The measures of a reward of scenes; each has a width of its own, as programs are kept."""
    monkeypatch.setattr(measures, "paid_by", lambda encoder: lambda stage, scene: pay(scene))
    films, parts = _parts()
    part, encoder = parts[number], EncoderConfig(7, width=width)
    seen = measures.along(NOT_ASKED, part.films, part.bits, encoder=encoder)
    return seen, measures.soundness(
        NOT_ASKED, jax.random.key(0), part.films, part.bits, jnp.arange(7), final_places(films, 7),
        seen.range, encoder=encoder, task=TASK, least=number + 1, number=60, ascents=4,
    )  # fmt: skip


def _done(scene):
    return TASK.done(scene.center, scene.size).sum().astype(jnp.float32)


@pytest.mark.parametrize("number", [0, 1])
def test_a_reward_that_is_true_progress_is_sound_by_a_whole_range(monkeypatch, number):
    seen, found = _measured(monkeypatch, _done, number, 21)
    assert (seen.range, seen.end_is_best) == (1, 1)
    assert (found.order, found.outbid, found.hack_gap) == (1, 0, 1)
    assert 20 < found.made_up <= 60


def test_a_reward_that_pays_the_opposite_is_outbid_by_all(monkeypatch):
    seen, found = _measured(monkeypatch, lambda scene: -_done(scene), 1, 22)
    assert (seen.range, seen.end_is_best) == (-1, 0)
    assert (found.order, found.outbid) == (0, 1)


def test_a_reward_of_touched_objects_is_outbid_where_activity_does_not_tell(monkeypatch):
    """All that moves in a stage is touched at its end, and in many a made-up state, too."""
    pay = lambda scene: scene.active[STAR].astype(jnp.float32)  # noqa: E731
    _, found = _measured(monkeypatch, pay, 1, 23)
    assert found.hack_gap == 0
    assert found.outbid == 0  # no more is paid than for the end
    assert found.order < 1


def test_a_reward_that_rises_with_time_is_in_order(monkeypatch):
    """The robot of these films is never still while a block is on its way."""
    films, (part, _) = _parts()
    place = films.center[:, :, ROBOT, 0]
    rising = part._replace(films=part.films._replace(
        center=part.films.center.at[:, :, ROBOT, 0].set(jnp.arange(place.shape[1]))
    ))  # fmt: skip
    monkeypatch.setattr(measures, "paid_by", lambda e: lambda stage, s: s.center[ROBOT, 0])
    seen = measures.along(NOT_ASKED, rising.films, rising.bits, encoder=EncoderConfig(7, width=24))
    np.testing.assert_allclose(seen.tau, 1.0, rtol=1e-6)
    assert seen.end_is_best == 1
    np.testing.assert_allclose(seen.range, np.mean(part.films.length - 1), rtol=1e-6)


def test_stages_done_are_counted_in_the_order_of_the_task():
    _, (first, second) = _parts()
    order = jnp.array([1, 0, 2, 3, 4, 5, 6])  # as if robot and region had changed places
    swapped = first.films._replace(
        center=first.films.center[:, :, order], size=first.films.size[:, :, order]
    )
    last = first.films.length - 1
    assert measures.done_at(TASK, first.films, jnp.arange(7), last).tolist() == [1] * 6
    assert measures.done_at(TASK, swapped, order, last).tolist() == [1] * 6
    assert measures.done_at(TASK, second.films, jnp.arange(7), 0).tolist() == [1] * 6
