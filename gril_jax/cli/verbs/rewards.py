"""Verbs that look into a run's learned reward, or take it elsewhere."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from gril_jax.config import RunConfig, TaskName, Variant
from gril_jax.config.command_line import RunFolder, parse
from gril_jax.config.files import load
from gril_jax.config.rules import between, count
from gril_jax.errors import RunError
from gril_jax.runs import run_dir

from .. import own_tasks
from ..arguments import Work, echo, require_new_file, run_config_of, take
from ..heavy_imports import heavy_imports
from . import Verb, experiment


@dataclass(frozen=True)
class _Audit:
    reward: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="REWARD_OR_RUN")]
    """A file of export-reward, or a run's folder."""
    task: TaskName | None = None
    """The task, or where the file of your own is now; by default the run's, or match_regions."""
    out: str | None = None
    """Folder for the results; by default RUN/audit, or NAME-audit beside NAME.npz."""
    variant: Variant | None = None
    """Quantities randomised at the start; None keeps the run's own variant."""
    ascents: int = field(default=1000, metadata=count())
    """Gradient ascents of the search for states with a high reward and no progress."""
    starts: int = field(default=4, metadata=count())
    """Starts of episodes, around which all states are made."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of all randomness."""


def _audit(args: list[str]) -> Work:
    about = "Find how a learned reward could be hacked, before a policy does."
    given = parse(_Audit, args, prog="gril audit", description=about)
    source = Path(given.reward)
    config = None
    if source.is_dir():
        config = run_config_of(source, "reward", task=given.task)
    elif not source.is_file():
        raise RunError(f"{source} does not exist, but must be a reward file or the folder of a run")
    elif given.task:  # XLA's options depend on the task
        (task,) = own_tasks.named([f"--env.name={given.task}"])[:1]
        config = load(None, [task], prog="gril audit")
    out = None if given.out is None else Path(given.out)
    if out is not None and out.exists() and not out.is_dir():
        raise RunError(f"{out} is a file, but --out must be a folder")
    task = config.env.name if config and not source.is_dir() else None
    options = vars(given) | {"out": out, "task": task}
    del options["reward"]
    return experiment("audit", source, config=config, devices=True, **options)


def _subtasks(args: list[str]) -> Work:
    from gril_jax.workflows.subtasks.options import Options

    about = "Find the stages of a task in a learned reward, and cut its demonstrations at them."
    task = take(args, "--task")
    options = parse(Options, args, prog="gril subtasks", description=about)
    folder = Path(options.run)
    run_config_of(folder, "reward", task=task)
    out = Path(options.out) if options.out else folder / "subtasks"
    run_dir.require_new(out)
    return experiment("subtasks.report", folder, out, options, devices=True)


@dataclass(frozen=True)
class _Export:
    run: RunFolder
    out: str
    """File to create, such as reward.npz or policy.npz."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""


def _export(part: str, args: list[str], about: str) -> tuple[Path, Path, RunConfig]:
    """A run, the new file for a part of it, and its configuration."""
    given = parse(_Export, args, prog=f"gril export-{part}", description=about)
    folder, out = Path(given.run), Path(given.out)
    config = run_config_of(folder, part, task=given.task)
    require_new_file(out)
    return folder, out, config


def _export_reward(args: list[str]) -> Work:
    about = "Write a run's learned reward as one file, which load_reward reads."
    folder, out, _ = _export("reward", args, about)
    return experiment("export_reward", folder, out)


def _export_policy(args: list[str]) -> Work:
    about = "Write a run's policy as an npz file that needs NumPy alone."
    folder, out, config = _export("policy", args, about)
    if config.run.algorithm == "ppo" and config.ppo.sub_policies > 1:
        raise RunError(
            f"the policy of {folder} is {config.ppo.sub_policies} sub-policies, chosen by the "
            "learned reward's stages, but a policy file holds one network: train with "
            "--ppo.sub-policies 1"
        )
    if config.run.algorithm == "ppo" and config.ppo.by_object:
        raise RunError(
            f"the policy of {folder} reads its observation object by object, but a policy file "
            "holds plain layers: train with --ppo.by-object false"
        )
    if config.run.algorithm == "ppo" and config.ppo.frame_stack > 1:
        raise RunError(
            f"the policy of {folder} sees {config.ppo.frame_stack} observations at a time, but a "
            "policy file holds what one needs: train with --ppo.frame-stack 1"
        )

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.export import policy_file
            from gril_jax.workflows.build import policy_setup, setup
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        hyper = policy_setup.algorithm_hyper(config)
        policy_file.main(folder, out, config, algorithm, hyper, echo=echo)

    return work


VERBS = (
    Verb("audit RUN|REWARD", "how a reward could be hacked, before a policy finds it", _audit),
    Verb(
        "subtasks RUN",
        "stages found in a run's learned reward, and demonstrations cut at them",
        _subtasks,
    ),
    Verb("export-reward RUN", "a run's reward as one file that load_reward reads", _export_reward),
    Verb("export-policy RUN", "a run's policy as plain NumPy arrays", _export_policy),
)
