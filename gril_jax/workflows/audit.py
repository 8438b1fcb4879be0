"""Searches for states that a learned reward overestimates, before a policy finds them.

gril audit RUN                      a run's reward, under a minute on two CPU cores
gril audit RUN --taught             what its perturbed frames teach, in its place
gril audit reward.npz --out found   a reward file

A reward passes the audit if each figure keeps its threshold in `gril_jax.audit.thresholds`. A
task without stages does not say what progress is: its audit is that of the videos alone. With
videos, those of a run or of `--demos`, rewards along them are measured, too (`held_out`).
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import envs
from gril_jax.audit import measures
from gril_jax.audit.made import States, make_states
from gril_jax.audit.measures import Audit
from gril_jax.audit.scene_reward import Scene, SceneReward, scene_reward
from gril_jax.audit.states import SUCCESS
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.tables import ENCODERS
from gril_jax.config.task import NO_TASK
from gril_jax.demos import schema
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.export.reward_file import load_reward
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.contrast import cost_options
from gril_jax.pretraining.hard_negatives import due_rewards
from gril_jax.report.audit_page import Findings
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import state_leaves
from gril_jax.runs.json_lines import plain, with_digest
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import write_whole
from gril_jax.workflows import export_reward, film_audit, held_out
from gril_jax.workflows.build import demonstrations, setup


def main(
    source: Path,
    *,
    task: str | None = None,
    demos: Path | None = None,
    out: Path | None = None,
    variant: str | None = None,
    ascents: int = 1000,
    starts: int = 4,
    seed: int = 0,
    taught: bool = False,
    echo: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Audits a reward; writes `audit.json`, which it returns, `report.html` and its pictures.

    The source is a run's folder or a file of `gril_jax.export.reward_file.save_reward`; task
    and variant of a run are its own if left out. Results go to `audit` in the run's folder, or
    beside the file under its name with "-audit". The starts, first frames of episodes, share the
    gradient searches (`ascents`). Without a task that has stages it is an audit of the videos
    alone, those of the run or of `demos`. Raises RunError if there is no reward yet, and
    ConfigError if reward and task do not fit together.
    """
    if out is None:
        own = source / ("audit-taught" if taught else "audit")
        out = own if source.is_dir() else source.with_name(f"{source.stem}-audit")
    asked = {"seed": seed, "ascents": ascents}
    found: Findings | film_audit.Findings
    if source.is_dir():
        asked["taught"] = taught
        learned, found, videos, about = _of_run(source, task, demos, variant, starts, **asked)
    elif taught:
        raise ConfigError(
            f"{source} does not say what it was taught, so --taught needs the folder of a run"
        )
    else:
        learned, found, videos, about = _of_file(source, task, demos, variant, starts, **asked)
    along = {} if videos is None else held_out.measured(*videos, [learned.params])[0]
    settings = {"source": str(source), "seed": seed} | about
    settings["reward_sha256"] = state_leaves.digest(learned.params)
    results = found.as_json() | plain(along) | {"settings": settings}
    with run_dir.writing(out):
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / "audit.json", with_digest(results) + "\n")
    of = f"what {source.name} is taught" if taught else source.name
    page = found.write_report(out, results, title=f"Audit of {of}")
    for line in (*found.in_words(), *held_out.lines(results), f"report: {page}"):
        echo(line)
    return results


# The reward, its audit, the videos to measure it on with their configuration, and what was done.
Videos = tuple[RunConfig, demonstrations.Demonstrations]
Audited = tuple[LearnedReward, Findings | film_audit.Findings, Videos | None, dict[str, Any]]


def _of_run(source, task, demos, variant, starts, *, ascents, seed, taught) -> Audited:
    """The audit of a run's reward, with what it did."""
    config = run_dir.read_config(source, demos=demos)
    if task not in (None, config.env.name):
        trained = "on videos alone" if config.env.name == NO_TASK else f"for {config.env.name}"
        raise ConfigError(f"{source} was trained {trained}, but --task is {task}")
    setup.require_boxes(config, "an audit, which moves boxes")
    learned = export_reward.of_run(source)
    if not has_stages(config.env):
        if taught:
            raise ConfigError(
                f"the task {config.env.name} has no `stages`, but --taught needs them"
            )
        alone = film_audit.of_run(source, config, scenes=ascents, seed=seed)
        return learned, alone, (config, alone.demos), {"scenes": alone.numbers["scenes"]}
    folder, videos = Path(config.demos.path or source / "demos"), None
    if (folder / schema.HEADER).is_file():
        videos = config, demonstrations.chosen(config, setup.task_of(config.env), folder)
    pay = _taught(learned, videos, source) if taught else None
    found, about = _searched(learned, config.env, source, variant, starts, ascents, seed, pay)
    return learned, found, None if taught else videos, about | {"taught": taught}


def _taught(learned: LearnedReward, videos: Videos | None, source: Path) -> SceneReward:
    """Minus the cost that perturbed frames of a run teach, as a reward without parameters.

    What fails its audit here cannot be mended by a longer training: the videos do not show it, or
    the options of the section loss say something else."""
    if videos is None:
        raise RunError(f"{source} has lost its demonstrations: name them with --demos")
    config, shown = videos
    if config.pretrain.num_perturbations == 0:
        raise ConfigError(
            f"pretrain.num_perturbations of {source} is 0, but must be above 0: nothing else "
            "teaches a cost"
        )
    film_audit.require_same_classes(learned, shown.demo_set)
    classes, hyper = learned.classes, setup.pretrain_hyper(config)
    static = setup.pretrain_config(config, classes)
    ends = pretrain.places(shown.batch("train"), len(classes), static)
    return lambda params, scene: due_rewards(ends, scene, **cost_options(hyper, static))


def _of_file(source, task, demos, variant, starts, *, ascents, seed) -> Audited:
    """The audit of a reward file, with what it did."""
    learned = load_reward(source)
    if isinstance(learned.config, PixelConfig):
        raise ConfigError(f"{source} takes pictures, but an audit moves boxes")
    chosen = env_of(learned, task) if task is not None or demos is None else None
    videos = None
    if demos is not None:
        videos = film_audit.with_demos(learned, chosen, load_demo_set(demos), str(source))
    if chosen is not None and has_stages(chosen):
        found, about = _searched(learned, chosen, source, variant, starts, ascents, seed)
        return learned, found, videos, about
    if videos is None:
        raise ConfigError(
            f"the task {chosen.name} has no `stages`, so its audit is that of the videos alone: "
            "name them with --demos"
        )
    config, shown = videos
    trained = film_audit.training_of(learned)
    alone = film_audit.measured(config, learned.params, shown, trained, scenes=ascents, seed=seed)
    return learned, alone, videos, {"scenes": alone.numbers["scenes"], "demos": str(demos)}


def _searched(
    learned: LearnedReward, chosen: EnvConfig, source, variant, starts, ascents, seed, pay=None
) -> tuple[Findings, dict[str, Any]]:
    asked = dict(variant=variant, ascents=ascents, starts=starts, seed=seed, pay=pay)
    with Progress() as progress:
        phase = progress.phase("auditing the reward", total=ascents, unit="searches")
        found = search(learned, chosen, str(source), **asked)
        phase.update(ascents)
    counted = math.prod(found.audit.found.reward.shape[:2])
    about = {"ascents": counted, "starts": starts, "variant": variant or _variant(chosen)}
    return found, about


def has_stages(chosen: EnvConfig) -> bool:
    """True if a task says what progress is; no task does not."""
    if chosen.name == NO_TASK:
        return False
    return getattr(setup.make_env(chosen, training=False), "stages", None) is not None


def search(
    learned: LearnedReward,
    chosen: EnvConfig,
    source: str,
    *,
    variant: str | None = None,
    ascents: int = 1000,
    starts: int = 4,
    seed: int = 0,
    pay: SceneReward | None = None,
) -> Findings:
    """The audit of a reward in a task, or of `pay` in its place; `source` names the reward in
    errors, those of `main`."""
    env, names, scenes = _scenes(learned, chosen, source, variant, starts, seed)
    stages = env.stages
    reward = pay or scene_reward(learned.config)
    first = jax.tree.map(lambda x: x[0], scenes)
    jax.eval_shape(reward, learned.params, first)  # of other sizes: refused before any work
    keys = jax.random.split(jax.random.key(seed), starts + 1)
    make = jax.vmap(functools.partial(make_states, task=stages))
    states = jax.jit(make)(keys[1:], scenes)
    score = np.asarray(states.battery.score)
    if (score[:, 0] > 0).any():
        raise ConfigError("the task's starts have made progress already, but must have made none")
    if (score.max(axis=1) < SUCCESS).any():
        done = ", ".join(stage.name for stage in stages.stages)
        raise ConfigError(f"no state was made with all of these stages done: {done}")
    run = functools.partial(measures.audit, reward, task=stages, states=states, ascents=ascents)
    with jax.debug_nans(False):  # a share of nothing is NaN; rewards are looked at below
        found: Audit = jax.tree.map(np.asarray, jax.jit(run)(learned.params, key=keys[0]))
    states = jax.tree.map(np.asarray, states)
    _check_finite(states, found, names)
    return Findings(states, found, names, stages)


def require_possible(config: RunConfig) -> None:
    """Raises ConfigError if a run asks for an audit that its reward does not allow."""
    none = f"run.audit is {config.run.audit}, but must be 0, because"
    if not ENCODERS[config.encoder.kind].boxes:
        raise ConfigError(
            f"{none} an audit moves boxes and encoder.kind is {config.encoder.kind!r}"
        )


def _variant(chosen: EnvConfig) -> str | None:
    """The variant that a task of this configuration has; None for one without variants."""
    return getattr(setup.staged_env(chosen, None), "variant", None)


def _scenes(
    learned: LearnedReward,
    chosen: EnvConfig,
    source: str,
    variant: str | None,
    starts: int,
    seed: int,
) -> tuple[envs.Env, tuple[str, ...], Scene]:
    """The task, the names of its objects, and first scenes with the reward's own labels."""
    env = setup.staged_env(chosen, variant)
    if getattr(env, "stages", None) is None:
        raise ConfigError(
            f"the task {chosen.name} has no `stages` (see gril_jax.envs.stages), so its states "
            "cannot be searched: an audit of the videos alone needs demonstrations"
        )
    export_reward.require_one_unit(learned, chosen.name, env, source)
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), 1), starts)
    objects = jax.jit(jax.vmap(lambda key: env.reset(key).objects))(keys)
    names = tuple(env.classes[i] for i in np.asarray(objects.label[0]))
    label = _labels(learned, env.classes, np.asarray(objects.label), source)
    resting = jnp.zeros(label.shape, bool)
    return env, names, Scene(objects.center, objects.size, label, objects.is_robot, resting)


def env_of(learned: LearnedReward, task: str | None) -> EnvConfig:
    """The task, by default the first of ours; one with targets has those of its usual blocks that
    the reward was made for."""
    chosen = EnvConfig(name=EnvConfig.name if task is None else task)
    chosen.check()
    if chosen.is_own:
        return chosen
    if "targets" not in envs.options(chosen.name):
        return chosen
    blocks = (*EnvConfig.targets, *EnvConfig.distractors)
    known = learned.objects or blocks
    targets = tuple(name for name in EnvConfig.targets if name in known)
    distractors = tuple(name for name in EnvConfig.distractors if name in known)
    if not targets or not {*known} <= {*targets, *distractors, "goal", "robot"}:
        raise ConfigError(
            f"the reward is for the objects {', '.join(known)}, but {chosen.name} has "
            f"goal, robot, {', '.join(blocks)}"
            + ": name its --task, or with --demos the videos that it was learned from"
            * (task is None)
        )
    return dataclasses.replace(chosen, targets=targets, distractors=distractors)


def _labels(learned: LearnedReward, classes, label: np.ndarray, source: str) -> jax.Array:
    """The task's labels as indices into the reward's classes."""
    for index in np.unique(label):
        if classes[index] not in learned.classes:
            raise ConfigError(
                f"{source} knows no class {classes[index]!r}, which the task has; its classes are "
                f"{', '.join(learned.classes)}"
            )
    index = [learned.classes.index(c) if c in learned.classes else 0 for c in classes]
    return jnp.array(index, jnp.int32)[label]


def _check_finite(states: States, found: Audit, names) -> None:
    """Raises RunError for the first state whose reward is not finite."""
    made = (*(judged.scene for judged in states.judged()), states.successes, found.found.scene)
    for scenes, paid in zip(made, (*found.rewards, found.found.reward), strict=True):
        unmet = scenes is found.found.scene  # a search that met no state of a kind has -inf there
        bad = np.argwhere(~np.isfinite(paid) & ~(unmet & (paid == -np.inf)))
        if len(bad):
            at = tuple(bad[0])
            places = zip(names, scenes.center[at], scenes.active[at], strict=True)
            said = (
                f"{name} ({x:.3f}, {y:.3f}){' active' * bool(on)}" for name, (x, y), on in places
            )
            where = ", ".join(said)
            raise RunError(f"the reward is {paid[at]} instead of a number at {where}")
