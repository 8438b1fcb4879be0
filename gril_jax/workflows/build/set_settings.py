"""Settings that a demonstration set decides: units, frame rate, and how much its boxes jitter."""

import dataclasses
import math

from gril_jax.config import RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.demos.demo_set import DemoSet

PRESET = "own_videos"  # of sets without a task
_TOGETHER = 4  # videos of a batch, at most
_WINDOW = 4.0  # seconds that a displacement is measured over


def fitted(config: RunConfig, demos: DemoSet) -> RunConfig:
    """The configuration with what depends on the set.

    Boxes that jitter need a rule that does not take jitter for motion. Without a task, units and
    frame rate are the set's own, too.
    """
    pool = config.pool
    if demos.noise is not None and pool.noise is None:
        pool = dataclasses.replace(pool, noise=demos.noise)
    config = dataclasses.replace(config, pool=pool)
    if config.env.name != NO_TASK:
        return config
    good = sum(demo.outcome != "failure" for demo in demos)
    together = max(2, min(_TOGETHER, good - math.ceil(good / 4)))
    window = max(1, round(_WINDOW * demos.fps))
    return dataclasses.replace(
        config,
        encoder=dataclasses.replace(config.encoder, length_unit=demos.half_extent),
        pool=dataclasses.replace(config.pool, window=window),
        pretrain=dataclasses.replace(config.pretrain, num_videos=together),
    )
