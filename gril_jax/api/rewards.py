"""Rewards in Python: learned from demonstrations, audited, and cut into subtasks."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from gril_jax.compilation import ahead
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.demos.demo_set import DemoSet
from gril_jax.errors import ConfigError, DemoError
from gril_jax.report.headline import faults
from gril_jax.reward import latent_reward
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs.memory import MemoryRun
from gril_jax.runs.progress import Progress
from gril_jax.subtasks import agreement
from gril_jax.workflows import audit as audits
from gril_jax.workflows import export_reward, film_audit
from gril_jax.workflows.build import demonstrations, learners, setup, vocabulary
from gril_jax.workflows.learning import encoders

from . import inputs, settings


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
        state = encoders.train(
            programs, config, name="pretrain", run=run, progress=shown, echo=print, what=what,
            row=lambda metrics: {"loss": metrics.loss.mean(axis=-1)},
        )  # fmt: skip
        trained = state, programs.data, programs.hyper
        params, measured = jax.device_get(
            (programs.reward.result()(*trained), programs.measure.result()(*trained))
        )
    words = vocabulary.with_task(config, vocabulary.of_set(demos, config.env.name))
    found = [
        export_reward.described(
            one,
            jax.tree.map(lambda x, i=i: jnp.asarray(x[i]), params),
            words,
            {"kendall_tau": float(measured["tau"][i]), "num_demos": len(chosen.names["train"])},
        )
        for i, one in enumerate(configs)
    ]
    return found if seeds else found[0]


@dataclasses.dataclass(frozen=True)
class Audit:
    """An audit's figures by name, and whether the reward keeps all bounds.

    `docs/audit.md` defines each figure. A reward from videos alone is asked less, because videos do
    not say what success is.
    """

    figures: Mapping[str, float]
    passed: bool
    lines: tuple[str, ...]
    """One sentence a figure, with its bound."""

    def __str__(self) -> str:
        verdict = "the reward passes its audit" if self.passed else "the reward fails its audit"
        return "\n".join([verdict, *self.lines])


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
      task: with stages, in whose states the reward is searched, by name or from `make`.
      demos: without a task: the demonstrations around whose ends states are made up.
      preset: the configuration that the reward was learned with, where `demos` are given.
      ascents: gradient searches, shared by the starts; without a task: states to make up.
      starts: first scenes to begin from.
      seed: of the search.

    Raises:
      ConfigError: neither task nor demonstrations are given, or the reward does not fit them.

    Example:
      print(audit_reward(reward, make("match_regions")))
    """
    if task is not None:
        chosen = (
            audits.env_of(reward, task)
            if isinstance(task, str)
            else inputs.env_config(task, EnvConfig())
        )
        findings = audits.search(
            reward, chosen, "the reward", ascents=ascents, starts=starts, seed=seed
        )
        numbers = {name: float(value) for name, value in findings.numbers().items()}
        return Audit(numbers, not faults(numbers), tuple(findings.in_words()))
    if demos is None:
        raise ConfigError(
            "an audit needs a task, or the demonstrations: audit_reward(reward, demos=...)"
        )
    config, chosen = _of_demos(reward, demos, preset)
    found = film_audit.measured(config, reward.params, chosen, scenes=ascents, seed=seed)
    numbers = {name: float(x) for name, x in found.items() if isinstance(x, int | float)}
    passed = bool(numbers.pop("passes_as_far_as_asked"))
    return Audit(numbers, passed, tuple(film_audit.in_words(found)[1:]))


@dataclasses.dataclass(frozen=True)
class Subtasks:
    """The stages on which demonstrations agree."""

    levels: tuple[float, ...]
    """The reward at the end of each stage."""
    ends: Mapping[str, Int[np.ndarray, "stages"]]
    """The last frame of each stage, by demonstration."""
    fps: float

    def __len__(self) -> int:
        return len(self.levels)

    def __str__(self) -> str:
        said = ", ".join(f"{level:.2f}" for level in self.levels)
        return f"{len(self)} stages in {len(self.ends)} demonstrations, at rewards of {said}"


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

    Example:
      print(find_subtasks(reward, demos))
      3 stages in 12 demonstrations, at rewards of -0.66, -0.35, -0.02
    """
    config, chosen = _of_demos(reward, demos, preset)
    learner, hyper = learners.learner(config, chosen), setup.pretrain_hyper(config)
    names = [*chosen.names["train"], *chosen.names["validation"]]
    batch = learner.films(names)
    latents = jax.jit(learner.latents)(reward.params.encoder, batch, hyper)
    traces = latent_reward(reward.params, latents)
    rule = {"prominence": prominence, "smoothing": smoothing, "support": support}
    if patience is None:
        _, found = agreement.agreed_stages(traces, batch.length, **rule)
    else:
        found = agreement.agreed_boundaries(traces, batch.length, **rule, patience=patience)
    found = jax.device_get(found)
    count = int(np.sum(found.kept))
    ends = {name: found.frames[i, :count] for i, name in enumerate(names)}
    levels = tuple(float(x) for x in found.level[:count])
    return Subtasks(levels, ends, demos.fps)


def _of_demos(
    reward: LearnedReward, demos: DemoSet, preset: str | None
) -> tuple[RunConfig, demonstrations.Demonstrations]:
    """The configuration of a reward and its demonstrations."""
    config = settings.for_demos(demos, preset, None, {}, 0)
    env = setup.task_of(config.env)
    chosen = demonstrations.of_set(config, env, demos)
    if tuple(chosen.demo_set.classes) != tuple(reward.classes):
        raise DemoError(
            f"the demonstrations show {', '.join(chosen.demo_set.classes)}, but the reward was "
            f"learned for {', '.join(reward.classes)}"
        )
    return export_reward.with_choices(config, reward, "the reward"), chosen
