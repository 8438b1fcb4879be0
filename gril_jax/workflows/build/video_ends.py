"""The share of a policy's episodes that end as the demonstrations do.

This is a test of success from the videos alone: neither the task's own test nor the learned reward
is asked, so it also shows a policy that exploits its reward. A frame costs what it lacks, by the
same measure as perturbed frames of the reward's training. Episodes are read as if they were videos.

Shapes use E for episodes, T for frames and N for objects.
"""

from collections.abc import Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gril_jax.audit.scene_reward import Scene
from gril_jax.config import RunConfig
from gril_jax.config.tables import REWARDS
from gril_jax.demos import schema
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.envs.base import Objects
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.contrast import cost_options
from gril_jax.pretraining.hard_negatives import due_rewards
from gril_jax.types import DemoBatch

from . import demonstrations, setup

_MORE = 0.25  # of the cost of a beginning, about: what a last frame may lack


def of_run(folder: Path, config: RunConfig, played: Objects) -> float | None:
    """The share of episodes, objects (E, T, N, ...), that end as the videos of a run do.

    None for a run that has learned no reward from boxes, for demonstrations that are gone, and
    for episodes with other objects than theirs: what these lack, the videos cannot tell."""
    form = REWARDS[config.run.reward_form]
    env = setup.make_env(config.env, training=False)
    kind = setup.encoder_config(config, len(env.classes))
    if not form.learns or config.run.reward_source or isinstance(kind, PixelConfig):
        return None
    source = Path(config.demos.path or folder / "demos")
    if not (source / schema.HEADER).is_file():
        return None
    demos = demonstrations.chosen(config, setup.task_of(config.env), source).batch("train")
    kinds = np.sort(demos.label[0]), np.sort(played.label[:, 0], axis=1)
    if kinds[0].shape != kinds[1].shape[1:] or (kinds[0] != kinds[1]).any():
        return None
    return share(as_videos(played), config, demos, env.classes)


def share(played: DemoBatch, config: RunConfig, demos: DemoBatch, classes: Sequence[str]) -> float:
    """The share of episodes whose last frame costs little more than that of the median video."""

    def ends(videos: DemoBatch) -> Float[Array, "E"]:
        due = owed(videos, config, demos, classes, touch=0.0)[1]
        return jnp.take_along_axis(due, videos.length[:, None] - 1, axis=1)[:, 0]

    return float(jnp.mean(ends(played) >= jnp.median(ends(demos)) - _MORE))


def owed(
    played: DemoBatch, config: RunConfig, demos: DemoBatch, classes: Sequence[str], **costs: float
) -> tuple[Scene, Float[Array, "E T"]]:
    """The scenes of episodes, leaves (E, T, N, ...), and the reward that each should have: minus
    the cost of what it lacks."""
    hyper = setup.pretrain_hyper(config)
    static = setup.pretrain_config(config, classes)
    places = jax.jit(pretrain.places, static_argnums=1)(demos, len(classes), static)
    still = played.label[:, None], played.is_robot[:, None]
    label, is_robot = (jnp.broadcast_to(x, played.center.shape[:3]) for x in still)
    bits = pretrain.activity_bits(played, hyper, static)
    scenes = Scene(played.center, played.size, label, is_robot, bits)
    return scenes, due_rewards(places, scenes, **cost_options(hyper, static) | costs)


def as_videos(seen: Objects) -> DemoBatch:
    """Episodes, objects (E, T, N, ...), as demonstrations of one length."""
    label, is_robot = seen.label[:, 0], seen.is_robot[:, 0]
    length = jnp.full(len(label), seen.center.shape[1], jnp.int32)
    return DemoBatch(seen.center, seen.size, label, is_robot, jnp.ones_like(is_robot), length)
