"""The ends of stages that are marked in a run's profiles."""

import jax.numpy as jnp
import numpy as np

from gril_jax.workflows.pretrain import _stage_ends

FRAMES = 160


def _stairs(*ends):
    """From -1 to 0 in rises of 12 frames that end at these frames."""
    trace = np.full(FRAMES, -1.0, np.float32)
    for i, end in enumerate(ends):
        trace[end - 12 : end + 1] = -1 + (i + np.linspace(0, 1, 13)) / len(ends)
        trace[end:] = -1 + (i + 1) / len(ends)
    return trace


def test_successes_have_the_ends_on_which_they_agree_and_failures_their_own():
    rng = np.random.default_rng(0)
    ends = [(30 + 2 * i, 80 - i, 125 + i) for i in range(5)]
    traces = [_stairs(*one) for one in ends]
    odd = traces[0].copy()
    odd[50:58] -= 0.3  # a slip, after which it climbs once more
    failure = np.where(np.arange(FRAMES) < 60, traces[1], -0.66)
    rewards = np.stack([odd, *traces, failure]) + rng.normal(0, 0.005, (7, FRAMES))
    length = jnp.array([150] * 6 + [140], jnp.int32)
    rewards[6, 140:] = rewards[6, 139]
    found = np.asarray(_stage_ends(jnp.asarray(rewards, jnp.float32), length, successes=6))
    for marked, own in zip(found, [ends[0], *ends], strict=False):
        assert np.abs(np.flatnonzero(marked) - own).max() <= 8
    (last,) = np.flatnonzero(found[6])
    assert abs(last - ends[1][0]) <= 8


def test_without_failures_there_is_nothing_else_to_mark():
    traces = jnp.asarray(np.stack([_stairs(40, 100)] * 3))
    found = _stage_ends(traces, jnp.full(3, FRAMES), successes=3)
    assert (np.asarray(found).sum(axis=1) == 2).all()
