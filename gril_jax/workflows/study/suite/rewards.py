"""Measures of a suite's rewards, and their files."""

from pathlib import Path
from typing import Any

from gril_jax.export.reward_file import save_reward
from gril_jax.workflows.build import setup, vocabulary
from gril_jax.workflows.study.measures import Measure, audit_figures, audit_program, ground, stacked

from .rows import Settings

_DEMO = "demo"
_KEPT = ("order", "touch", "push", "hack_gap", "hack_share", "hack_gap_anywhere", "outbid")
FIGURES = ("tau", *_KEPT)


def audit(settings: Settings) -> Measure:
    """The audit of a row's rewards from Demo starts of its own task."""

    def made(config):
        return ground(
            {_DEMO: setup.make_env(config.env, training=False, variant=_DEMO)},
            starts=settings.starts,
        )

    def encoder(config):
        return setup.encoder_config(config, len(setup.make_env(config.env, training=False).classes))

    def same(config):
        return config.env.name, encoder(config)

    def lower(config, params):
        on = made(config)
        run = audit_program(encoder(config), on.task, ascents=settings.ascents)
        return [run.lower(params, on.states[_DEMO])]

    def figures(programs, config, found) -> dict[str, Any]:
        values = audit_figures(*programs, stacked(found), made(config))
        return {name: values[f"{name}_{_DEMO}"].tolist() for name in _KEPT}

    return Measure("audit", figures, same, lower)


def files(folder: str = "rewards") -> Measure:
    """Writes each reward to a file, with its goals."""

    def write(programs, config, found) -> dict[str, Any]:
        env = setup.make_env(config.env, training=False)
        words = vocabulary.of_task(env, config.env.name)
        out = Path(config.run.out) / folder
        out.mkdir(parents=True, exist_ok=True)
        for seed, one in enumerate(found, start=config.run.seed):
            save_reward(
                out / f"{config.env.name}-{seed}.npz", one.params,
                setup.encoder_config(config, len(words.classes)), classes=words.classes,
                robots=words.robots, objects=words.objects, activity=config.pool.rule(),
                half_extent=words.half_extent, unit=words.unit,
                provenance={"kendall_tau": one.tau, "seed": seed}, overwrite=True,
            )  # fmt: skip
        return {"files": [f"{config.env.name}-{config.run.seed + i}" for i in range(len(found))]}

    return Measure("files", write)
