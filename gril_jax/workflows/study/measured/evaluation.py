"""Figures of encoders on demonstrations kept aside, as `gril train` has them."""

from collections.abc import Callable

import jax

from gril_jax.config import RunConfig
from gril_jax.pretraining import pretrain
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations

from ..rewards import task_key
from .measure import Measure, num_classes, stacked

NUMBERS = ("tau", "reward_time_tau", "reward_last")


def measure(gather: Callable[[RunConfig], Demonstrations]) -> Measure:
    """The figures that `pretrain.evaluate` finds of each encoder."""

    def static(config: RunConfig) -> pretrain.Static:
        return setup.pretrain_config(config, num_classes(config.env))

    def same(config):
        return task_key(config), config.demos, static(config)

    def lower(config, params):
        demos, kept = gather(config), static(config)
        held, train = demos.batch("validation"), demos.batch("train")

        def one(params, hyper):
            return pretrain.evaluate(params.encoder, held, train, hyper, kept)

        return [jax.jit(jax.vmap(one, (0, None))).lower(params, setup.pretrain_hyper(config))]

    def measured(programs, config, found):
        values = programs[0](stacked(found), setup.pretrain_hyper(config))
        return {name: values[name].tolist() for name in NUMBERS}

    return Measure("evaluation", measured, same, lower)
