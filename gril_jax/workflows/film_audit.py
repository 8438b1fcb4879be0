"""Audits a reward by its videos alone: what can be asked without the stages of a task.

gril audit RUN            a run of videos, or of a task without stages; seconds on two CPU cores

Held-out videos say how a demonstration begins and ends. The audit makes up scenes of two kinds from
them. In the first nothing has moved, but everything counts as touched. In the second an object has
been put elsewhere at the end. The reward of both must be low. The audit also doubts a reward whose
boxes are doubtful: many are missing, or training has not aligned the videos. No state is searched.
"""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.audit.thresholds import Audited
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.files import load
from gril_jax.demos import schema
from gril_jax.demos.demo_set import DemoSet
from gril_jax.errors import DemoError, RunError
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.batch import Ends, displaced
from gril_jax.pretraining.contrast import cost_options
from gril_jax.pretraining.hard_negatives import due_rewards
from gril_jax.report.film_audit_page import write_videos_report
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs import places
from gril_jax.runs.json_lines import plain
from gril_jax.runs.reading import read_phases, require_same_demos
from gril_jax.types import DemoBatch
from gril_jax.workflows import export_reward
from gril_jax.workflows.build import demonstrations, policy_setup, setup, vocabulary

LEFT_OUT = (
    "left out, because videos do not define success: the gradient search, the hack gap, the "
    "ranking of synthetic stages and the maps, which gril audit has for a task with stages"
)
_OF_TIMES = ("tcc", "tcc_cosine")  # losses that are squared errors of aligned times
_DONE = "from this reward on a state counts as done"
_AMISS = 0.25  # cost of a made-up scene that is clearly not done; of a beginning it is about 1


class Findings(NamedTuple):
    """One audit of videos alone."""

    numbers: Mapping[str, Any]
    worst_end: Scene  # the last frame of a held-out video with the lowest reward
    best_amiss: Scene  # the scene with something out of place that has the highest reward
    demos: demonstrations.Demonstrations

    def as_json(self) -> dict[str, Any]:
        """Everything as JSON."""
        found = Audited("videos", self.numbers)
        return plain({**self.numbers, **found.as_json(), "left_out": LEFT_OUT})

    def in_words(self) -> list[str]:
        """The verdict, a line for each figure, and what is left out."""
        found = Audited("videos", self.numbers)
        return [found.sentence(), *found.lines(), *done_lines(self.numbers), LEFT_OUT]

    def write_report(self, folder: Path, results: Mapping[str, Any], *, title: str) -> Path:
        """Writes and returns the page of the audit."""
        label, classes = self.best_amiss.label, self.demos.demo_set.classes
        scenes = [
            (f"worst end: {self.numbers['worst_end']:.2f}", self.worst_end),
            (f"misplaced: {self.numbers['best_amiss']:.2f}", self.best_amiss),
        ]
        return write_videos_report(
            folder, scenes, [classes[i] for i in np.asarray(label)], results,
            half_extent=self.demos.demo_set.half_extent, title=title,
        )  # fmt: skip


def of_run(folder: Path, config: RunConfig, *, scenes: int, seed: int) -> Findings:
    """The audit of a run's reward; `scenes` are made up around held-out videos.

    Raises RunError if the videos are gone.
    """
    setup.require_boxes(config, "an audit, which moves boxes")
    source = Path(config.demos.path or folder / "demos")
    places.require(source, "the audit makes its scenes from these videos")
    require_same_demos(folder, source / schema.HEADER)
    demos = demonstrations.chosen(config, setup.task_of(config.env), source)
    words = vocabulary.of_run(config, folder)
    params = policy_setup.learned_reward(folder, config, words)
    known = read_phases(folder).finished.get("reward", {})
    return measured(config, params, demos, known, scenes=scenes, seed=seed)


def with_demos(
    learned: LearnedReward, task: EnvConfig | None, demo_set: DemoSet, source: str
) -> tuple[RunConfig, demonstrations.Demonstrations]:
    """The configuration of a reward file, and the demonstrations of a set as that has them.

    Raises ConfigError or DemoError if they do not fit together; `source` names the reward.
    """
    config = load(vocabulary.PRESET if task is None else "own_task")
    if task is not None:
        config = dataclasses.replace(config, env=task)
    config = vocabulary.fitted_to_set(config, demo_set)
    demos = demonstrations.of_set(config, setup.task_of(config.env), demo_set)
    require_same_classes(learned, demos.demo_set)
    return export_reward.with_choices(config, learned, source), demos


def require_same_classes(learned: LearnedReward, demos: DemoSet) -> None:
    """Raises DemoError if demonstrations show other classes than a reward was learned for."""
    if tuple(demos.classes) != tuple(learned.classes):
        raise DemoError(
            f"the demonstrations show {', '.join(demos.classes)}, but the reward was learned for "
            f"{', '.join(learned.classes)}"
        )


def training_of(learned: LearnedReward) -> dict[str, Any]:
    """The figures of training that a reward tells of itself."""
    known = learned.about.get("provenance", {}) if learned.description else {}
    return {"tau": known.get("kendall_tau"), "consistency": known.get("consistency")}


def measured(
    config: RunConfig,
    params: RewardParams,
    demos: demonstrations.Demonstrations,
    trained: Mapping[str, Any],
    *,
    scenes: int = 1000,
    seed: int = 0,
) -> Findings:
    """The audit of a reward with its demonstrations; `trained` has the `tau` and `consistency`
    that training came to, if they are known. Shares are of the range from first to last frames.

    Raises RunError if the reward is not finite somewhere.
    """
    classes = demos.demo_set.classes
    num_classes, hyper = len(classes), setup.pretrain_hyper(config)
    static = setup.pretrain_config(config, classes)
    train, held = demos.batch("train"), demos.batch("validation")
    ends = pretrain.places(train, num_classes, static)
    bits = pretrain.activity_bits(held, hyper, static)
    pay = jax.jit(jax.vmap(functools.partial(scene_reward(static.encoder), params)))
    movable = held.present & ~held.is_robot
    begin, end = _frames(held, bits, 0 * held.length), _frames(held, bits, held.length - 1)
    first, last = pay(begin), pay(end)
    touched = pay(begin._replace(active=begin.active | movable))
    spread = jnp.maximum(jnp.mean(last - first), 1e-6)
    made = _amiss(jax.random.key(seed), held, end, ends, scenes, static.encoder.length_unit)
    costs = cost_options(hyper, static) | {"touch": 0.0}
    amiss = np.asarray(-due_rewards(ends, made, **costs)) > _AMISS
    reward = np.where(amiss, np.asarray(pay(made)), -np.inf)
    if not amiss.any():  # nothing could be displaced: the beginnings stand in
        made, amiss, reward = begin, np.ones(len(first), bool), np.asarray(first)
    paid = np.concatenate([first, last, touched, reward[amiss]])
    if lost := np.count_nonzero(~np.isfinite(paid)):
        raise RunError(
            f"the reward is not finite in {lost} of {len(paid)} states of the demonstrations or "
            "near them, so it cannot be audited; learn it again with lower weights of the section "
            "loss"
        )
    pick = lambda scene, at: jax.tree.map(lambda x: np.asarray(x[at]), scene)  # noqa: E731
    numbers = {
        "range": float(spread),
        "touch_share": float(jnp.mean(touched - first) / spread),
        "scenes": int(amiss.sum()),
        "misranked_share": float(np.mean(reward[amiss] > float(last.min()))),
        "best_amiss_share": float((reward.max() - jnp.mean(first)) / spread),
        "missing_share": missing_share(demos),
        "worst_end": float(last.min()),
        "best_amiss": float(reward.max()),
        "done_level": done_level(float(last.min()), float(reward.max())),
        **{name: trained.get(name) for name in ("tau", "consistency")},
    }
    if config.loss.consistency not in _OF_TIMES:
        numbers["consistency"] = None
    shown = pick(end, int(jnp.argmin(last))), pick(made, int(reward.argmax()))
    return Findings(numbers, *shown, demos)


def done_lines(numbers: Mapping[str, Any]) -> list[str]:
    """A line on the reward of a state that counts as done; none where there is no such reward."""
    level = numbers.get("done_level")
    return [] if level is None else [f"{'done_level':16} {level:7.3f}  {_DONE}"]


def done_level(worst_end: float, best_amiss: float) -> float | None:
    """The reward from which on a state counts as done: halfway between the worst end of a video and
    the best scene with something out of place; None if that scene has the higher one.

    >>> done_level(0.0, -0.25)
    -0.125
    """
    return None if best_amiss >= worst_end else (worst_end + best_amiss) / 2


def missing_share(demos: demonstrations.Demonstrations) -> float:
    """The share of frames without a box of the class that lacks most, over all demonstrations; the
    robot may leave the picture, so it does not count."""
    own, lacking = demos.demo_set, dict[str, list[float]]()
    for demo in own:
        for i, label in enumerate(demo.tracks.label):
            if demo.tracks.seen[:, i].any() and own.classes[label] not in own.robots:
                missing = 1 - float(demo.tracks.seen[:, i].mean())
                lacking.setdefault(own.classes[label], []).append(missing)
    return max((float(np.mean(each)) for each in lacking.values()), default=0.0)


def _frames(demos: DemoBatch, bits, at) -> Scene:
    """One frame of each video, leaves (B, N, ...)."""
    rows = jnp.arange(len(at))
    still = demos.label, demos.is_robot
    return Scene(demos.center[rows, at], demos.size[rows, at], *still, bits[rows, at])


def _amiss(key, held: DemoBatch, end: Scene, places: Ends, number: int, unit) -> Scene:
    """Ends of videos with some objects displaced, leaves (number, N, ...). The key is consumed."""
    extent = jnp.max(jnp.abs(held.center))
    which = jnp.arange(number) % len(held.length)

    def one(key, film):
        scene, demo = (jax.tree.map(lambda x: x[film], tree) for tree in (end, held))
        boxes = scene.center, scene.size, scene.active
        copy = displaced(key, *boxes, demo, places, extent, unit)
        return scene._replace(center=copy.center, size=copy.size, active=copy.active)

    return jax.jit(jax.vmap(one))(jax.random.split(key, number), which)
