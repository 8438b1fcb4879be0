"""Verbs that learn a reward and a policy, and show what a run came to."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from gril_jax.config import Variant
from gril_jax.config.command_line import RunFolder, parse
from gril_jax.config.rules import between, count
from gril_jax.errors import ConfigError
from gril_jax.runs import phases, run_dir

from .. import help_page, own_films
from ..arguments import (
    Work,
    echo,
    hard_negatives,
    positional,
    resumed_config,
    run_config,
    run_config_of,
    take,
)
from ..heavy_imports import heavy_imports
from . import Verb, experiment

_TRAIN = "Learn a reward, then a policy from it."


def _new_run(
    name: str, of: str | None, args: list[str], prog: str, about: str, *, films: bool = False
) -> Work:
    """A new run, or with --resume one that was cut off; `of` None takes the defaults, or with
    `films`, which need no task, what the demonstration set says."""
    resume, negatives = take(args, "--resume"), take(args, "--hard-negatives")
    if dry := "--dry-run" in args:
        args.remove("--dry-run")
        if resume is not None or negatives is not None:
            raise ConfigError("--dry-run is for a new run, without --resume and --hard-negatives")
    sections = help_page.TRAIN if name == "train" else help_page.PRETRAIN
    extra: dict[str, Any] = {}
    if resume is None:
        if films:
            of, args = own_films.configured(of, args)
        config = run_config(of, args, prog, about, sections, films_alone=films)
        if negatives is not None:
            extra["hard_negatives"] = hard_negatives(negatives, config)
    else:
        if negatives is not None:
            raise ConfigError(
                "--hard-negatives is given beside --resume, but a run that goes on has its own"
            )
        extra["resume"] = folder = Path(resume)
        config = resumed_config(folder, of, args, prog=prog, experiment=name)
    if dry:
        return experiment("dry_run", config, config=config, devices=True, verb=name)
    return experiment(name, config, config=config, devices=True, **extra)


def _quickstart(args: list[str]) -> Work:
    resumes = any(arg.partition("=")[0] == "--resume" for arg in args)
    name = None if resumes else "quickstart"  # what goes on may have begun otherwise
    return _new_run("train", name, args, "gril quickstart", _TRAIN)


def _train(args: list[str]) -> Work:
    return _new_run("train", positional(args), args, "gril train", _TRAIN)


def _pretrain(args: list[str]) -> Work:
    about = "Learn a reward; without CONFIG, from films of your own that --demos names."
    return _new_run("pretrain", positional(args), args, "gril pretrain", about, films=True)


@dataclass(frozen=True)
class _Report:
    run: RunFolder


def _report(args: list[str]) -> Work:
    given = parse(_Report, args, prog="gril report", description="Draw a run's figures.")
    folder = Path(given.run)
    run_dir.read_config(folder)  # nothing of the task is run, so it need not be there
    if phases.read_phases(folder).experiment == "sweep":
        return _redrawn(folder)
    phases.require_single(folder)
    return experiment("report", folder)


def _redrawn(folder: Path) -> Work:
    def work() -> None:
        with heavy_imports():
            from gril_jax.workflows.study import summary
        summary.redraw(folder, echo)

    return work


@dataclass(frozen=True)
class _Eval:
    run: RunFolder
    episodes: int = field(default=256, metadata=count())
    """Starts to draw; a rate says how many of them are distinct."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the episodes."""
    variant: Variant | None = None
    """Variant of the task to start in. None is as a run evaluates itself: from the variant that has
    many starts, from the one that starts elsewhere, and from the task's own start if it has one."""
    engine: Literal["kernel", "impulse", "mjx"] | None = None
    """Physics solver to play in, of MatchRegions and MAGICAL's tasks; None is the run's own."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""


def _eval(args: list[str]) -> Work:
    options = dict(vars(parse(_Eval, args, prog="gril eval", description="Play a run's policy.")))
    folder = Path(options.pop("run"))
    config = run_config_of(folder, task=options.pop("task"))
    return experiment("evaluate", folder, config=config, devices=True, **options)


VERBS = (
    Verb("quickstart", "a small run from demonstrations to a policy, on a laptop", _quickstart),
    Verb(
        "train [CONFIG]",
        "the same for any configuration",
        _train,
        {
            "train|pretrain|sweep --resume RUN": "go on with what was cut off, bit for bit",
            "train|pretrain --hard-negatives RUN[,RUN]":
                "learn from states that earlier rewards overestimated",
        },
    ),
    Verb("report RUN", "figures and tables of a run", _report),
    Verb("eval RUN", "success of a run's policy over distinct starts, and its return", _eval),
    Verb("pretrain [CONFIG]", "the learned reward alone", _pretrain),
)  # fmt: skip
