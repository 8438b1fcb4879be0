"""Choices of encoder training that matter: each changed alone, over several seeds.

    gril ablate match_regions_fast --demos DEMOS --seeds 5

Writes `ablate.md`, `ablate.csv` and `ablate.png`. On a GPU it takes minutes, on two CPU cores
hours: there `--pretrain.steps 500` is enough to see what matters.
"""

import jax

from gril_jax.pretraining import pretrain
from gril_jax.report.figures.curves import spread
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.measures import Measure, stacked
from gril_jax.workflows.study.results import Table
from gril_jax.workflows.study.written import SEEDS, Column, Section, by_row, markdown

_NUMBERS = ("tau", "reward_time_tau", "reward_last")
_SECTION = Section(
    "On demonstrations kept aside: mean over seeds (lowest to highest).",
    [SEEDS, *map(Column, _NUMBERS, ("tau", "reward against time", "last reward"))],
)


def _measures(config, settings, demos: Demonstrations) -> list[Measure]:
    """The figures that `pretrain.evaluate` finds of each encoder."""
    num_classes = len(demos.demo_set.classes)
    held, train = demos.batch("validation"), demos.batch("train")

    def same(config):
        return setup.pretrain_config(config, num_classes)

    def lower(config, params):
        def one(params, hyper):
            return pretrain.evaluate(params.encoder, held, train, hyper, same(config))

        return [jax.jit(jax.vmap(one, (0, None))).lower(params, setup.pretrain_hyper(config))]

    def measured(programs, config, found):
        values = programs[0](stacked(found), setup.pretrain_hyper(config))
        return {name: values[name].tolist() for name in _NUMBERS}

    return [Measure("evaluation", measured, same, lower, num_classes)]


TABLE = Table(
    "ablate",
    columns=lambda lines: ("row", "seed", *_NUMBERS),
    text=lambda found: markdown(found.lines, [_SECTION]),
    figure=lambda found: spread(by_row(found.lines, "tau"), "tau on held-out videos"),
    measured={"evaluation": _NUMBERS},
    measures=_measures,
)
