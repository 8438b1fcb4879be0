"""Choices of encoder training that matter: each changed alone, over several seeds.

    gril ablate match_regions_fast --demos DEMOS --seeds 5

Each static choice compiles a program; other rows and all seeds share them. Writes `ablate.md`,
`ablate.csv` and `ablate.png`. On a GPU it takes minutes, on two CPU cores hours: there
`--pretrain.steps 500` is enough to see what matters.
"""

from collections.abc import Mapping

import jax
from gril_jax.experiments.pipeline import setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations
from gril_jax.experiments.tables.measures import Measure, blank_rewards, stacked
from gril_jax.experiments.tables.table import Found, Table
from gril_jax.experiments.tables.written import SEEDS, Column, Section, by_row, markdown

from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.pretraining import pretrain
from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import png

from .rows import Settings

_NUMBERS = ("tau", "reward_time_tau", "reward_last")
_SECTION = Section(
    "On demonstrations kept aside: mean over seeds (lowest to highest).",
    [SEEDS, *map(Column, _NUMBERS, ("tau", "reward against time", "last reward"))],
)


def _measures(config, settings: Settings, demos: Demonstrations) -> list[Measure]:
    """The figures that `pretrain.evaluate` finds of each encoder."""
    num_classes = len(demos.demo_set.classes)
    held, train = demos.batch("validation"), demos.batch("train")
    same = lambda config: setup.pretrain_config(config, num_classes)  # noqa: E731

    def compile_for(config, count):
        def one(params, hyper):
            return pretrain.evaluate(params.encoder, held, train, hyper, same(config))

        with ahead.tracing():
            blank, hyper = blank_rewards(config, num_classes, count), setup.pretrain_hyper(config)
            lowered = jax.jit(jax.vmap(one, (0, None))).lower(blank, hyper)
        return compiled(lowered)

    def measured(program, config, found):
        values = program(stacked(found), setup.pretrain_hyper(config))
        return {name: values[name].tolist() for name in _NUMBERS}

    return [Measure("evaluation", measured, same, compile_for)]


def _pictures(found: Found, last: bool) -> Mapping[str, bytes]:
    return {"ablate.png": png(spread(by_row(found.lines, "tau"), "tau on held-out videos"))}


TABLE = Table(
    "ablate",
    lambda lines: ("row", "seed", *_NUMBERS),
    lambda found: markdown(found.lines, [_SECTION]),
    _pictures,
    settings=Settings,
    measured={"evaluation": _NUMBERS},
    measures=_measures,
)
