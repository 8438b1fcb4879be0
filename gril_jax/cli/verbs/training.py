"""Verbs that learn a reward and a policy, and show what a run came to."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from gril_jax.config import RunConfig
from gril_jax.config.command_line import RunFolder
from gril_jax.config.files import sections
from gril_jax.config.run_config import Sections
from gril_jax.config.tables import ALIGNMENTS, REWARDS, between, count
from gril_jax.errors import ConfigError
from gril_jax.runs import places, reading, run_dir

from ..arguments import Work, demo_set, echo, hard_negatives, require_task_of, run_config_of
from ..configured import ConfigName, new_run, read, require_surroundings, start
from ..heavy_imports import heavy_imports
from . import Verb, experiment, simple

_TRAIN = "Learn a reward, then a policy from it."


@dataclass(frozen=True)
class _Own:
    config: ConfigName = None
    resume: str | None = None
    """Folder of a run that was cut off, to go on with bit for bit."""
    hard_negatives: str | None = None
    """Runs whose rewards overestimated states to learn from: one, or two with a comma."""
    rounds: int = field(default=1, metadata=between(1, 8))
    """Rewards and policies to learn, one after the other: each reward also learns from states that
    the two policies before it found to be overestimated."""
    dry_run: bool = False
    """Say what would run, how long and in how much memory; write nothing."""


@dataclass(frozen=True)
class _Train(_Own, Sections):
    pass


def _run(given: _Train, name: str, prog: str, *, films: bool = False) -> Work:
    """A new run of an experiment, or with `resume` one that was cut off."""
    extra: dict[str, Any] = {}
    if given.resume is not None:
        config, extra["resume"] = _resumed(given, name), Path(given.resume)
    else:
        config = new_run(given, prog, films_alone=films)
    if given.hard_negatives is not None:
        extra["hard_negatives"] = hard_negatives(given.hard_negatives, config)
    if given.rounds > 1:
        _require_rounds(given, name, config)
        return experiment("rounds", config, config=config, devices=True, rounds=given.rounds)
    if given.dry_run:
        return experiment("dry_run", config, config=config, devices=True, verb=name)
    return experiment(name, config, config=config, devices=True, **extra)


def _require_rounds(given: _Train, name: str, config: RunConfig) -> None:
    """Raises ConfigError if there is nothing that rounds could learn from one another."""
    if name != "train" or not REWARDS[config.run.reward_form].learns or config.run.reward_source:
        raise ConfigError(
            f"--rounds is {given.rounds}, but must be 1 where no reward and policy are learned"
        )
    if config.encoder.kind == "pixels" or ALIGNMENTS[config.loss.consistency].head:
        raise ConfigError(
            f"--rounds is {given.rounds}, but must be 1 for a reward that reads pictures or "
            "predicts progress: hard negatives teach distances between boxes"
        )


def _resumed(given: _Train, name: str) -> RunConfig:
    """The configuration of a run to resume; a ConfigError with the fields in which the options
    beside it say something else."""
    folder = Path(given.resume)
    noted = sections(str(folder / "config.yaml")).demos.path
    told = given.demos.path
    begun = "demos" in reading.read_phases(folder).finished
    if noted in (None, told) or not begun:  # before that, nothing says that it is the same set
        told = None
    demos = None if told is None else demo_set(told)
    config = run_dir.require_resumable(folder, name, demos=demos)
    if demos is not None or given.demos.path == noted:
        path = config.demos.path
        given = dataclasses.replace(given, demos=dataclasses.replace(given.demos, path=path))
    task = given.env.name if given.env.name != config.env.name else None
    require_task_of(config, task, folder)
    env = dataclasses.replace(given.env, name=config.env.name)
    run = dataclasses.replace(given.run, out=given.run.out or config.run.out)
    if changed := reading.changed_fields(
        config, RunConfig.of(dataclasses.replace(given, env=env, run=run))
    ):
        raise ConfigError(
            f"a resumed run keeps the configuration in {folder / 'config.yaml'}, but the command "
            f"line gives {', '.join(changed)}"
        )
    if config.demos.path is not None:
        places.require(Path(config.demos.path), "the run learns from it")
    require_surroundings(config, folder)
    return config


def _begun(given: _Train, name: str, new: Sections | None) -> Sections | None:
    """The sections that options are read above: those of the run to resume, or of a new one; a
    ConfigError for options that exclude each other."""
    if given.dry_run and (given.resume is not None or given.hard_negatives is not None):
        raise ConfigError("--dry-run is for a new run, without --resume and --hard-negatives")
    alone = given.resume is None and given.hard_negatives is None and not given.dry_run
    if given.rounds > 1 and not alone:
        raise ConfigError(
            f"--rounds is {given.rounds}, but must be 1 beside --resume, --hard-negatives or "
            "--dry-run"
        )
    if given.resume is not None and given.hard_negatives is not None:
        raise ConfigError(
            "--hard-negatives is given beside --resume, but a run that goes on has its own"
        )
    if given.resume is None:
        return new
    run_dir.require_resumable(Path(given.resume), name)
    return sections(given.config or str(Path(given.resume) / "config.yaml"))


def _quickstart(args: list[str]) -> Work:
    def begin(given: _Train) -> Sections | None:
        if given.config is not None:
            raise ConfigError(f"there is no use for {given.config!r}: see gril quickstart --help")
        return _begun(given, "train", sections("quickstart"))

    given = read(_Train(), args, "gril quickstart", _TRAIN, begin)
    return _run(given, "train", "gril quickstart")


def _train(args: list[str]) -> Work:
    begin = lambda given: _begun(given, "train", start(given))  # noqa: E731
    return _run(read(_Train(), args, "gril train", _TRAIN, begin), "train", "gril train")


def _pretrain(args: list[str]) -> Work:
    prog = "gril pretrain"
    about = "Learn a reward; without CONFIG, from videos of your own that --demos names."
    begin = lambda given: _begun(given, "pretrain", start(given, films_alone=True))  # noqa: E731
    given = read(_Train(), args, prog, about, begin, policies=False)
    return _run(given, "pretrain", prog, films=True)


@dataclass(frozen=True)
class _Report:
    run: RunFolder
    demos: str | None = None
    """Folder of the run's demonstration set now; None: where it was, or beside the run."""


def _report(given: _Report) -> Work:
    folder, demos = Path(given.run), None if given.demos is None else demo_set(given.demos)
    run_dir.read_config(folder)  # nothing of the task is run, so it need not be there
    if reading.read_phases(folder).experiment == "sweep":
        return _redrawn(folder)
    reading.require_single(folder)
    return experiment("report", folder, demos=demos)


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
    """Initial states to sample; a rate says how many of them are distinct."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the episodes."""
    variant: str | None = None
    """Variant of the task to start in, such as jitter. None is as a run evaluates itself: from
    perturbed and held-out initial states, and from the nominal one if there is a single one."""
    engine: Literal["kernel", "impulse", "mjx"] | None = None
    """Physics solver to play in, of MatchRegions and MAGICAL's tasks; None is the run's own."""
    film: bool = False
    """Write RUN/eval.mp4: the worst, the median and the best episode by return."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""


def _eval(given: _Eval) -> Work:
    options = dict(vars(given))
    folder = Path(options.pop("run"))
    config = run_config_of(folder, task=options.pop("task"))
    config.env.require_variant("--variant", given.variant)
    return experiment("evaluate", folder, config=config, devices=True, **options)


@dataclass(frozen=True)
class _Demo:
    out: str = "demo.mp4"
    """Video to write; it takes the place of one that is there."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the initial state."""


def _demo(given: _Demo) -> Work:
    return experiment("demo", Path(given.out), seed=given.seed)


VERBS = {
    "Learn a reward, and a policy from it": (
        simple(
            "demo", "play a trained policy, and plot its learned reward, in seconds", _Demo, _demo
        ),
        Verb(
            "quickstart", "a small run from demonstrations to a policy, on a laptop", _quickstart,
            schema=_Train,
        ),
        Verb(
            "train [CONFIG]", "the same for any configuration", _train,
            {
                "train|pretrain|sweep --resume RUN": "go on with what was cut off, bit for bit",
                "train|pretrain --hard-negatives RUN[,RUN]":
                    "learn from states that earlier rewards overestimated",
            },
            schema=_Train,
        ),
        Verb("pretrain [CONFIG]", "the learned reward alone", _pretrain, schema=_Train),
        simple(
            "eval RUN", "success of a run's policy over distinct starts, and its return",
            _Eval, _eval,
        ),
        simple(
            "report RUN", "figures and tables of a run", _Report, _report,
        ),
    )
}  # fmt: skip
