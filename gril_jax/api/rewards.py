"""Rewards in Python: learned from demonstrations, audited, and cut into subtasks."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from gril_jax.audit.thresholds import Audited
from gril_jax.compilation import ahead
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.config.run_config import StageOptions
from gril_jax.config.tables import require
from gril_jax.demos.demo_set import DemoSet
from gril_jax.errors import ConfigError, RunError
from gril_jax.reward import latent_reward
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs.memory import MemoryRun
from gril_jax.runs.progress import Progress
from gril_jax.types import checked
from gril_jax.workflows import audit as audits
from gril_jax.workflows import export_reward, film_audit, held_out
from gril_jax.workflows.build import demonstrations, learners, setup, vocabulary
from gril_jax.workflows.learning import diverged, encoders
from gril_jax.workflows.subtasks import report as subtask_report
from gril_jax.workflows.subtasks.doubts import of_demonstrations
from gril_jax.workflows.subtasks.ends import of_video, segments

from . import inputs, settings


@checked
def learn_reward(
    demos: DemoSet,
    *,
    preset: str | None = None,
    task: Any = None,
    seeds: int | None = None,
    seed: int = 0,
    progress: bool = True,
    **options: Any,
) -> LearnedReward | list[LearnedReward]:
    """Learns a reward from demonstrations: no actions, no rewards, no task are needed.

    Args:
      demos: of `import_videos` or `load_demos`; three or more.
      preset: a shipped configuration or the path of a YAML file; by default that of the
        demonstrations' task, or `own_videos` if they have none.
      task: what the demonstrations show, if their set does not say: by name or from `make`.
      seeds: how many rewards to learn side by side in one compiled program, from `seed` on; None
        learns one.
      progress: show a progress line on stderr.
      options: sections of the configuration with the fields to change: `pretrain={"steps": 2000}`.

    Returns:
      The reward; with `seeds` a list of as many.

    Raises:
      ConfigError: an option is unknown or out of range.
      DemoError: the demonstrations are too few, or are not of the task.
      RunError: a reward diverged.

    Example:
      demos = load_demos("mine")
      reward = learn_reward(demos, pretrain={"steps": 2000})
      reward.save("kitchen.npz")
    """
    config = settings.for_demos(demos, preset, task, options, seed)
    chosen = demonstrations.of_set(config, setup.task_of(config.env), demos)
    learner = learners.learner(config, chosen)
    configs = [with_seed(config, number) for number in range(seeds or 1)]
    what = "learning the reward" if len(configs) == 1 else f"learning {len(configs)} rewards"
    with (
        MemoryRun() as run,
        Progress(shown=progress) as shown,
        ahead.compiling() as pool,
    ):
        programs = encoders.compiled_for(configs, learner, pool)
        trained = encoders.train(
            programs, configs, name="pretrain", run=run, progress=shown, echo=print, what=what,
            row=lambda metrics: {"consistency": metrics.consistency.mean(axis=-1)},
        )  # fmt: skip
        aligned = run.metrics()[-1]["consistency"]
    diverged.require_all(trained.diverged, config.run.seed)
    params, measured = jax.device_get((trained.rewards, trained.measures))
    words = vocabulary.with_task(config, vocabulary.of_set(demos, config.env.name))
    found = [
        export_reward.described(
            one,
            jax.tree.map(lambda x, i=i: jnp.asarray(x[i]), params),
            words,
            {"consistency": aligned[i], "num_demos": len(chosen.names["train"])}
            | ({"kendall_tau": float(measured["tau"][i])} if "tau" in measured else {}),
        )
        for i, one in enumerate(configs)
    ]
    return found if seeds else found[0]


@dataclasses.dataclass(frozen=True)
class Audit:
    """An audit's figures by name, and whether the reward keeps all thresholds.

    `docs/audit.md` defines each figure. Without a task that has stages, it is an audit of the
    videos alone.
    """

    figures: Mapping[str, float]
    passed: bool
    verdict: str
    """A sentence, with the reasons if the reward fails."""
    lines: tuple[str, ...]
    """One line a figure, with its threshold if it has one."""
    kind: str
    """"task", or "videos" if no state was searched."""
    misranked: Mapping[str, float]
    """The share of clear successes that are not above the best state found, by its kind of
    shortfall, the worst first; empty if no state was searched."""

    def __str__(self) -> str:
        return "\n".join([self.verdict, *self.lines])


@checked
def audit_reward(
    reward: LearnedReward,
    task: Any = None,
    *,
    demos: DemoSet | None = None,
    preset: str | None = None,
    ascents: int = 300,
    starts: int = 4,
    seed: int = 0,
) -> Audit:
    """Searches for states that a reward overestimates, before a policy finds them.

    Args:
      reward: of boxes.
      task: by name or from `make`; its states are searched if it has stages.
      demos: rewards are measured along held-out ones. Without a task, or for one without stages,
        scenes are made up around their ends.
      preset: the configuration that the reward was learned with, where `demos` are given.
      ascents: gradient searches, shared by the starts; without a task: states to make up.
      starts: first scenes to begin from.
      seed: of the search.

    Raises:
      ConfigError: neither a task with stages nor demonstrations are given, or the reward does not
        fit them.

    Example:
      print(audit_reward(reward, make("match_regions")))
    """
    if task is not None:
        chosen = (
            audits.env_of(reward, task)
            if isinstance(task, str)
            else inputs.env_config(task, EnvConfig())
        )
        if audits.has_stages(chosen):
            findings = audits.search(
                reward, chosen, "the reward", ascents=ascents, starts=starts, seed=seed
            )
            misranked = {kind: share for kind, (share, _) in findings.shortfalls().items()}
            along = {}
            if demos is not None:
                along = held_out.measured(*_of_demos(reward, demos, preset, task), [reward.params])[
                    0
                ]
            return _audit("task", findings.numbers() | along, misranked)
        if demos is None:
            raise ConfigError(
                f"the task {chosen.shown_name} has no `stages`, so its audit is that of the videos "
                "alone, which needs them: audit_reward(reward, demos=...)"
            )
    if demos is None:
        raise ConfigError(
            "an audit needs a task, or the demonstrations: audit_reward(reward, demos=...)"
        )
    config, shown = _of_demos(reward, demos, preset, task)
    trained = film_audit.training_of(reward)
    made = film_audit.measured(config, reward.params, shown, trained, scenes=ascents, seed=seed)
    along = held_out.measured(config, shown, [reward.params])[0]
    return _audit("videos", made.numbers | along, {})


def _audit(kind: str, numbers: Mapping[str, Any], misranked: Mapping[str, float]) -> Audit:
    known = {name: float(value) for name, value in numbers.items() if value is not None}
    found = Audited(kind, known, next(iter(misranked), ""))
    lines = (*found.lines(), *film_audit.done_lines(numbers), *held_out.lines(numbers))
    return Audit(known, found.passes, found.sentence(), lines, kind, misranked)


@dataclasses.dataclass(frozen=True)
class Subtasks:
    """The stages on which demonstrations agree."""

    levels: tuple[float, ...]
    """The reward at the end of each stage."""
    ends: Mapping[str, Int[np.ndarray, "stages"]]
    """The last frame of each stage, by demonstration."""
    fps: float
    video_segments: Mapping[str, tuple[Mapping[str, Any], ...]]
    """The stages in frames and seconds of the imported videos, by demonstration."""
    doubts: Mapping[str, tuple[str, ...]]
    """Reasons to doubt the stages of a demonstration, by its name; those without doubt are left
    out."""

    def __len__(self) -> int:
        return len(self.levels)

    def __str__(self) -> str:
        said = ", ".join(f"{level:.2f}" for level in self.levels)
        one = "1 stage" if len(self) == 1 else f"{len(self)} stages"
        lines = [f"{one} in {len(self.ends)} demonstrations, at rewards of {said}"]
        lines += [f"doubtful: {name} {', '.join(why)}" for name, why in self.doubts.items()]
        return "\n".join(lines)


@checked
def find_subtasks(
    reward: LearnedReward,
    demos: DemoSet,
    *,
    preset: str | None = None,
    prominence: float = 0.125,
    smoothing: int = 15,
    patience: int | None = None,
    support: float = 0.5,
) -> Subtasks:
    """Finds the stages of a task: the steps in which a reward climbs along demonstrations.

    Args:
      reward: learned from demonstrations of the same job.
      demos: to be cut into stages.
      preset: the configuration that the reward was learned with; the default is that of
        `learn_reward`.
      prominence: least height of a stage's rise; a reward goes from about -1 to 0.
      smoothing: frames of the running median, odd.
      patience: frames without progress that end a stage; None finds it from the demonstrations.
      support: least share of the demonstrations that show a stage's end by themselves.

    Raises:
      ConfigError: a number is out of its range, or the reward does not fit the demonstrations.
      RunError: the demonstrations agree on no end of a stage.

    Example:
      print(find_subtasks(reward, demos))
      3 stages in 12 demonstrations, at rewards of -0.66, -0.35, -0.02
    """
    config, chosen = _of_demos(reward, demos, preset)
    learner, hyper = learners.learner(config, chosen), setup.pretrain_hyper(config)
    names = [*chosen.names["train"], *chosen.names["validation"]]
    batch = learner.films(names)
    latents = jax.jit(learner.latents)(reward.params.encoder, batch, hyper)
    traces = subtask_report.Traces(
        chosen.demo_set.select(names), [name in chosen.names["validation"] for name in names],
        np.asarray(latent_reward(reward.params, latents)), np.asarray(batch.length),
    )  # fmt: skip
    rule = {"prominence": prominence, "smoothing": smoothing, "support": support}
    options = StageOptions(run="", patience=patience, **rule)
    for one in dataclasses.fields(options):
        require(one.name, getattr(options, one.name), one.metadata)
    found, alone, rule = subtask_report.discover(traces, options)
    stages = subtask_report.stages_of(traces, found, alone, rule, demos.fps)
    if not len(stages.level):
        raise RunError(
            "the demonstrations agree on no end of a stage, but one is needed at least: try a "
            f"lower prominence (it was {prominence:g}), smoothing or support"
        )
    doubts = zip(names, map(tuple, of_demonstrations(stages)), strict=True)
    shown = zip(traces.demos, stages.ends, strict=True)
    return Subtasks(
        tuple(map(float, stages.level)),
        dict(zip(names, stages.ends, strict=True)),
        demos.fps,
        {d.name: tuple(of_video(d, part, demos.fps) for part in segments(e)) for d, e in shown},
        {name: why for name, why in doubts if why},
    )


def _of_demos(
    reward: LearnedReward, demos: DemoSet, preset: str | None, task: Any = None
) -> tuple[RunConfig, demonstrations.Demonstrations]:
    """The configuration of a reward and its demonstrations."""
    config = settings.for_demos(demos, preset, task, {}, 0)
    env = setup.task_of(config.env)
    chosen = demonstrations.of_set(config, env, demos)
    film_audit.require_same_classes(reward, chosen.demo_set)
    return export_reward.with_choices(config, reward, "the reward"), chosen
