"""Verbs that look into a run's learned reward, or take it elsewhere."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gril_jax.config import EnvConfig, RunConfig, TaskName
from gril_jax.config.command_line import RunFolder
from gril_jax.config.run_config import StageOptions, require_one_network
from gril_jax.config.tables import between, count
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir

from ..arguments import Work, demo_set, echo, named_task, require_new_file, run_config_of
from ..heavy_imports import heavy_imports
from . import experiment, simple


@dataclass(frozen=True)
class _Audit:
    reward: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="REWARD_OR_RUN")]
    """A file of gril export, or a run's folder."""
    task: TaskName | None = None
    """The task, or where the file of your own is now; by default the run's, or match_regions."""
    demos: str | None = None
    """Demonstrations for an audit of videos alone; of a run: where they are now."""
    out: str | None = None
    """Folder for the results; by default RUN/audit, or NAME-audit beside NAME.npz."""
    variant: str | None = None
    """Quantities randomised at the start, such as layout; None keeps the run's own variant."""
    ascents: int = field(default=1000, metadata=count())
    """Gradient searches for states with a high reward and no success."""
    starts: int = field(default=4, metadata=count())
    """Starts of episodes; all states of the audit are made around them."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of all randomness."""
    taught: bool = False
    """Audit what the perturbed frames of a run teach, in place of what was learned."""


def _audit(given: _Audit) -> Work:
    source = Path(given.reward)
    demos = None if given.demos is None else demo_set(given.demos)
    config = None
    if source.is_dir():
        config = run_config_of(source, "reward", task=given.task, demos=demos)
    elif not source.is_file():
        raise RunError(f"{source} does not exist, but must be a reward file or the folder of a run")
    elif given.task:  # XLA's options depend on the task
        config = RunConfig(env=EnvConfig(name=named_task(given.task) or given.task))
    (config.env if config else EnvConfig()).require_variant("--variant", given.variant)
    out = None if given.out is None else Path(given.out)
    if out is not None and out.exists() and not out.is_dir():
        raise RunError(f"{out} is a file, but --out must be a folder")
    task = config.env.name if config and not source.is_dir() else None
    options = vars(given) | {"out": out, "task": task, "demos": demos}
    del options["reward"]
    return experiment("audit", source, config=config, devices=True, **options)


def _subtasks(given: StageOptions) -> Work:
    folder = Path(given.run)
    demos = None if given.demos is None else demo_set(given.demos)
    run_config_of(folder, "reward", task=given.task, demos=demos)
    out = Path(given.out) if given.out else folder / "subtasks"
    if not (out / "subtasks.json").is_file():  # what an earlier call wrote is refined
        run_dir.require_new(out)
    return experiment("subtasks.report", folder, out, given, devices=True)


@dataclass(frozen=True)
class _Export:
    run: RunFolder
    out: str
    """File to create, such as reward.npz or policy.npz."""
    what: Literal["reward", "policy"] = "reward"
    """The learned reward, as one file that load_reward reads, or the policy, as one that needs
    NumPy alone."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""
    progress: str | None = None
    """Folder of the LeRobot dataset that the run's videos are of: the file, such as
    sarm_progress.parquet, has the progress of each of its frames."""


def _export(given: _Export) -> Work:
    folder, out = Path(given.run), Path(given.out)
    if given.progress is not None and given.what != "reward":
        raise ConfigError("--progress is of the reward, but --what is policy")
    config = run_config_of(folder, given.what, task=given.task)
    require_new_file(out)
    if given.progress is not None:
        return experiment("export_progress", folder, out, Path(given.progress), devices=True)
    if given.what == "reward":
        return experiment("export_reward", folder, out)
    require_one_network(config)

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.export import policy_file
            from gril_jax.workflows.build import policy_setup, setup
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        policy = policy_setup.restore_policy(folder, config, algorithm)
        policy_file.save(out, config, algorithm, policy)
        echo(f"wrote {out}")

    return work


VERBS = {
    "Look into a reward, take it elsewhere": (
        simple(
            "audit RUN|REWARD", "how a reward could be hacked, before a policy finds it",
            _Audit, _audit,
        ),
        simple(
            "subtasks RUN",
            "stages found in a run's learned reward, and demonstrations cut at them",
            StageOptions, _subtasks,
        ),
        simple(
            "export RUN --out FILE",
            "a run's reward, or with --what policy its policy, as one file", _Export, _export,
        ),
    )
}  # fmt: skip
