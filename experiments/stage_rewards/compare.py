"""Compares three ways to get the rewards of stages from films (see `ways`): JSON, and a table.

    python -m gril_jax.experiments.stage_rewards.compare --cuts found match_regions_fast \
        --demos.path DEMOS --encoder.width 32 --encoder.latent 16 --pretrain.steps 1500

Three minutes on 2 CPU cores. `Options` come first, then a configuration with options of `gril
pretrain`. Films are cut where the reward of the encoder of whole films shows the ends of stages, as
`gril subtasks` does (`--cuts found`), or as soon as so many of the task's own stages hold for good
(`--cuts true`). All figures are of films kept aside.
"""

import dataclasses
import itertools
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.experiments.fidelity.physics_parity import printed
from gril_jax.experiments.pipeline import demonstrations, policy_rewards, setup

from gril_jax import reward
from gril_jax.config import RunConfig, files
from gril_jax.errors import ConfigError, DemoError
from gril_jax.pretraining import pretrain
from gril_jax.subtasks import agreement

from . import measures, ways
from .segments import cut, true_ends

FIGURES = ("tau", "end_is_best", "range", "order", "outbid", "hack_gap", "made_up")


@dataclass(frozen=True)
class Options:
    """What is compared."""

    seeds: int = 3
    """Encoders, and states, of so many seeds."""
    cuts: Literal["found", "true"] = "found"
    """Ends of stages, see above."""
    number: int = 1000
    """Made-up states of each stage."""
    ascents: int = 20
    """Gradient ascents from the beginning of each segment."""


def compare(config: RunConfig, options: Options) -> list[dict[str, Any]]:
    """The figures of each seed."""
    env = setup.make_env(config.env, training=False)
    if config.demos.path is None or getattr(env, "stages", None) is None:
        raise ConfigError("a set, --demos.path, and a task with stages are needed")
    demos = demonstrations.chosen(config, env, Path(config.demos.path))
    label = np.asarray(jax.jit(env.reset)(jax.random.key(0)).objects.label)
    shown = np.asarray(demos.batch("train").label)[0]
    order = jnp.asarray(policy_rewards.in_the_order_of(label, shown))
    return [of_seed(config, options, demos, env.stages, order, n) for n in range(options.seeds)]


def of_seed(config: RunConfig, options: Options, demos, stages, order, seed: int) -> dict[str, Any]:
    """The figures of one seed: of the ends of stages, and of each way and stage."""
    classes = demos.demo_set.classes
    static = setup.pretrain_config(config, len(classes), classes)
    hyper, steps = setup.pretrain_hyper(config), config.pretrain.steps
    films = demos.batch("train"), demos.batch("validation")
    key = jax.random.fold_in(jax.random.key(seed), 0)
    shared = ways.trained(key, films[0], hyper, static, steps)
    learned = pretrain.learned_reward(shared.encoder, films[0], hyper, static)
    paid = [_traces(shared, learned, x, hyper, static) for x in films]
    true = [true_ends(stages, x, order) for x in films]
    if options.cuts == "true" and min(x.min() for x in true) < 0:
        raise DemoError(f"{demos.demo_set.folder}: a film does not end with all stages done")
    ends = _found(paid, films) if options.cuts == "found" else true
    bits = [pretrain.activity_bits(x, hyper, static) for x in films]
    parts, held = (cut(*x) for x in zip(films, bits, ends, strict=True))
    level = jnp.mean(jnp.take_along_axis(paid[0], ends[0], axis=1), axis=0)
    found = {
        "landings": ways.landings(shared, learned, level),
        "goals": ways.goals(shared, parts, hyper, static),
        "fresh": ways.fresh(key, parts, hyper, static, steps, share=False),
        "fresh, steps shared": ways.fresh(key, parts, hyper, static, steps, share=True),
    }
    places = pretrain.places(films[0], len(classes), static)
    made = [_made_up(stages, part, order) for part in held]

    def figures(way: ways.Way, number: int) -> dict[str, float]:
        one, part, least = way.stages[number], held[number], made[number]
        own = ways.own_bits(part, hyper, static) if way.restarts else part.bits
        seen = measures.along(one, part.films, own, encoder=static.encoder)
        numbers = seen._asdict()
        if least is not None:
            numbers |= measures.soundness(
                one, jax.random.fold_in(key, number + 1), part.films, own, order, places,
                seen.range, encoder=static.encoder, task=stages, least=least,
                number=options.number, ascents=options.ascents,
            )._asdict()  # fmt: skip
        return {name: round(float(x), 4) for name, x in numbers.items()}

    same = ends[1].shape == true[1].shape
    return {
        "seed": seed,
        "stages": len(parts),
        "frames": [float(np.median(part.films.length)) for part in held],
        "frames_off": np.median(np.abs(ends[1] - true[1]), axis=0).tolist() if same else None,
        "ways": {
            name: {
                "steps": way.steps,
                "seconds": round(way.seconds, 1),
                "stages": [figures(way, number) for number in range(len(parts))],
            }
            for name, way in found.items()
        },
    }


def _traces(shared, learned, films, hyper, static):
    latents = pretrain.embed(shared.encoder, films, hyper, static)
    return reward.latent_reward(learned, latents)


def _found(paid, films) -> list[np.ndarray]:
    """Ends of stages on which all films agree, (B, K) of those trained on and of the others."""
    longest = max(x.shape[1] for x in paid)
    traces = [jnp.pad(x, ((0, 0), (0, longest - x.shape[1])), mode="edge") for x in paid]
    length = jnp.concatenate([x.length for x in films])
    shared = jax.jit(agreement.agreed_stages)(jnp.concatenate(traces), length)[1]
    count = int(jnp.sum(shared.kept))
    if not count:
        raise ConfigError("the films agree on no stage: --cuts true takes the task's own")
    return np.split(np.asarray(shared.frames)[:, :count], [len(paid[0])])


def _made_up(stages, part, order) -> int | None:
    """How many of the task's stages are done where a segment ends; None if no more than before."""
    begin, end = (
        int(np.median(measures.done_at(stages, part.films, order, at)))
        for at in (0, part.films.length - 1)
    )
    return end if end > begin else None


def table(found: Sequence[dict[str, Any]]) -> str:
    """A Markdown table: a line a way and stage, means over the seeds with as many stages."""
    lines = ["| way: stage | seeds | " + " | ".join(FIGURES) + " | s |", "|" + " --- |" * 10]
    for count in sorted({one["stages"] for one in found}):
        seeds = [one["ways"] for one in found if one["stages"] == count]
        for name, number in itertools.product(seeds[0], range(count)):
            each = [seed[name]["stages"][number] for seed in seeds]
            means = [np.mean([x.get(figure, np.nan) for x in each]) for figure in FIGURES]
            means.append(np.mean([seed[name]["seconds"] for seed in seeds]))
            numbers = " | ".join(f"{mean:.2f}" for mean in means)
            lines.append(f"| {name}: {number + 1} of {count} | {len(seeds)} | {numbers} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the figures as JSON, and the table behind them to stderr."""
    options, rest = tyro.cli(Options, args=argv, return_unknown_args=True)

    def work() -> dict[str, Any]:
        if not rest:
            raise ConfigError("the name of a configuration is missing")
        name, *overrides = rest
        config = files.load(name, overrides, prog="stage_rewards")
        found = compare(config, options)
        sys.stderr.write(table(found) + "\n")
        return {"configuration": name, **dataclasses.asdict(options), "found": found}

    return printed("stage_rewards", work)


if __name__ == "__main__":
    sys.exit(main())
