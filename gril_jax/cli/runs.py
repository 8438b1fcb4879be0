"""Verbs that make a run, or read one."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from gril_jax.config import Variant
from gril_jax.config.command_line import parse
from gril_jax.errors import ConfigError, RunError
from gril_jax.report import kinds as report_kinds
from gril_jax.runs import run_dir

from .arguments import (
    Work,
    echo,
    hard_negatives,
    positional,
    require_new_file,
    resumed_config,
    run_config,
    take,
)
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]


@dataclass(frozen=True)
class _Eval:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""
    episodes: int = 100
    """Episodes to play."""
    seed: int = 0
    """Seed of the episodes."""
    variant: Variant | None = None
    """What is drawn at the start; None keeps the run's own variant."""


@dataclass(frozen=True)
class _Report:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""


@dataclass(frozen=True)
class _ExportPolicy:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""
    out: str
    """File to create, such as policy.npz."""


@dataclass(frozen=True)
class _ExportReward:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""
    out: str
    """File to create, such as reward.npz."""


def _quickstart(args: list[str]) -> Work:
    name = None if _resumes(args) else "quickstart"  # what goes on may have begun otherwise
    return _plan("train", name, args, "gril quickstart", "Learn a reward, then a policy from it.")


def _train(args: list[str]) -> Work:
    about = "Learn a reward, then a policy from it."
    return _plan("train", positional(args), args, "gril train", about)


def _pretrain(args: list[str]) -> Work:
    return _plan("pretrain", positional(args), args, "gril pretrain", "Learn a reward.")


def _resumes(args: list[str]) -> bool:
    return any(arg.partition("=")[0] == "--resume" for arg in args)


def _plan(experiment: str, name: str | None, args: list[str], prog: str, about: str) -> Work:
    """A new run, or with --resume one that was cut off."""
    resume, cheats = take(args, "--resume"), take(args, "--hard-negatives")
    extra: dict[str, Any] = {}
    if resume is None:
        about = (
            f"{about} --resume RUN goes on with a run that was cut off. --hard-negatives RUN,RUN "
            "learns the reward from what the policies of one or two runs were overpaid for, too."
        )
        config = run_config(name, args, prog, about)
        if cheats is not None:
            extra["hard_negatives"] = hard_negatives(cheats, config)
    else:
        if cheats is not None:
            raise ConfigError(
                "--hard-negatives is given beside --resume, but a run that goes on has its own"
            )
        extra["resume"] = folder = Path(resume)
        config = resumed_config(folder, name, args, prog=prog, experiment=experiment)

    def work() -> None:
        with heavy_imports(config, devices=True):
            if experiment == "train":
                from gril_jax.experiments import train as chosen
            else:
                from gril_jax.experiments import pretrain as chosen
        chosen.main(config, echo=echo, **extra)

    return work


def _eval(args: list[str]) -> Work:
    given = parse(_Eval, args, prog="gril eval", description="Play a run's policy.")
    if given.episodes < 1:
        raise ConfigError(f"--episodes is {given.episodes}, but must be at least 1")
    if not 0 <= given.seed < 2**31:
        raise ConfigError(f"--seed is {given.seed}, but must be from 0 to {2**31 - 1}")
    folder = Path(given.run)
    config = run_dir.read_config(folder)

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments import evaluate
        evaluate.main(
            folder, episodes=given.episodes, seed=given.seed, variant=given.variant, echo=echo
        )

    return work


def _report(args: list[str]) -> Work:
    given = parse(_Report, args, prog="gril report", description="Draw a run's figures.")
    folder = Path(given.run)
    run_dir.read_config(folder)
    of_table1 = report_kinds.made_by(folder) == "table1"
    if not of_table1:
        report_kinds.require_single(folder)

    def work() -> None:
        with heavy_imports():
            if of_table1:
                from gril_jax.experiments.table1 import table1
                from gril_jax.experiments.tables import results
            else:
                from gril_jax.experiments import report
        if of_table1:
            results.redraw(table1.TABLE, folder, echo=echo)
        else:
            report.main(folder, echo=echo)

    return work


def _export_policy(args: list[str]) -> Work:
    about = "Write a run's policy as an npz file that needs NumPy alone."
    given = parse(_ExportPolicy, args, prog="gril export-policy", description=about)
    folder, out = Path(given.run), Path(given.out)
    config = run_dir.read_config(folder)
    if not any(folder.glob("policy/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no policy, so its run has not got that far yet")
    require_new_file(out)

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments.pipeline import policy_setup, setup
            from gril_jax.interop import policy_file
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        hyper = policy_setup.algorithm_hyper(config)
        policy_file.main(folder, out, config, algorithm, hyper, echo=echo)

    return work


def _export_reward(args: list[str]) -> Work:
    about = "Write a run's learned reward as one file, which load_reward reads."
    given = parse(_ExportReward, args, prog="gril export-reward", description=about)
    folder, out = Path(given.run), Path(given.out)
    run_dir.read_config(folder)
    if not any(folder.glob("reward/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no reward, so its run has not got that far yet")
    require_new_file(out)

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments import export_reward
        export_reward.main(folder, out, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {
    "quickstart": _quickstart,
    "train": _train,
    "pretrain": _pretrain,
    "eval": _eval,
    "report": _report,
    "export-policy": _export_policy,
    "export-reward": _export_reward,
}
