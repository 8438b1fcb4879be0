"""A learned reward taken out of its run: `gril export RUN --out FILE`; or into another one, where a
policy is trained on it: `gril train --reward FILE|RUN`."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.reward import LossConfig
from gril_jax.config.tables import ALIGNMENTS, ENCODERS, find
from gril_jax.config.task import NO_TASK
from gril_jax.demos import schema
from gril_jax.encoders.ensemble import num_members
from gril_jax.envs import Env
from gril_jax.errors import ConfigError
from gril_jax.export import reward_format
from gril_jax.export.reward_file import load_reward
from gril_jax.graphs import activity_rule
from gril_jax.graphs.activity_rule import PAPER
from gril_jax.losses import heads
from gril_jax.report.data import read_finished
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs import run_dir
from gril_jax.runs.reading import require_same_demos

from .build import policy_setup, setup, vocabulary
from .build.vocabulary import Vocabulary


def main(folder: Path, out: Path, *, echo: Callable[[str], None] = print) -> None:
    """Writes the reward of a run to a new file."""
    learned = of_run(folder)
    learned.save(out)
    echo(f"wrote {out}")
    if run_dir.read_config(folder).env.name == NO_TASK:
        about = learned.about
        echo(
            f"lengths are in {about['unit']}: a frame shows {about['half_extent']:g} to each side "
            f"of its middle, {about['provenance']['fps']:g} frames a second; objects: "
            f"{', '.join(learned.objects)}"
        )


def of_run(folder: Path) -> LearnedReward:
    """The reward that a run has learned; a RunError if it has none yet."""
    config = run_dir.read_config(folder)
    words = vocabulary.of_run(config, folder)
    params = policy_setup.learned_reward(folder, config, words)
    known: dict[str, Any] = {"run": folder.resolve().name}
    demos = Path(config.demos.path or folder / "demos") / schema.HEADER
    require_same_demos(folder, demos)
    if demos.is_file():  # its entries hold the digests of the demonstrations
        known["demos_sha256"] = schema.digest(demos)
    found = read_finished(folder) or {}
    known |= {ours: found[name] for ours, name in _TRAINED.items() if name in found}
    return described(config, params, words, known)


# What a file says of training, and its names in a run's results.
_TRAINED = {"kendall_tau": "tau", "consistency": "consistency"}


def described(
    config: RunConfig, params: RewardParams, words: Vocabulary, known: Mapping[str, Any]
) -> LearnedReward:
    """A reward's parameters with all that is needed to use it; `known` is what else is known of
    its training, for `about`."""
    extent = words.half_extent
    if config.encoder.kind == "pixels" and config.env.name != NO_TASK:
        env = setup.make_env(config.env, training=False)
        if hasattr(env, "render"):
            extent = setup.seen_half_extent(env, config.encoder.pixels)
    learned = LearnedReward(
        params, setup.encoder_config(config, len(words.classes)), tuple(words.classes),
        tuple(words.robots), tuple(words.objects), activity_rule.from_json(config.pool.rule()),
    )  # fmt: skip
    provenance = {"seed": config.run.seed, "fps": words.fps, **known}
    text = reward_format.describe(learned, float(extent), words.unit, provenance)
    return dataclasses.replace(learned, description=text)


def load_learned(source: Path) -> LearnedReward:
    """The reward in a file of `LearnedReward.save`, or of a run's folder.

    Raises:
      RewardFileError: there is no such file, or it is damaged.
      RunError: the folder is no run, or has no reward yet.
    """
    return of_run(source) if source.is_dir() else load_reward(source)


def configured(config: RunConfig, learned: LearnedReward, env: Env, source: str) -> RunConfig:
    """The configuration with the encoder, activity rule and number of goals of a reward.

    Args:
      config: of the run that will use it; `env` is its task.
      learned: the reward; `source` names it in errors.

    Raises:
      ConfigError: the reward was learned for other classes or another unit than the task's, or has
        an encoder or an activity rule that no configuration has.
    """
    if tuple(learned.classes) != tuple(env.classes):
        raise ConfigError(
            f"{source} was learned for the classes {', '.join(learned.classes)}, but "
            f"{config.env.shown_name} has {', '.join(env.classes)}: both must have the same words "
            "in the same order"
        )
    require_one_unit(learned, config.env.name, env, source)
    return with_choices(config, learned, source)


def require_one_unit(learned: LearnedReward, task: str, env: Env, source: str) -> None:
    """Raises ConfigError if a reward's lengths are of another unit than the task's."""
    unit, extent = (learned.about.get(name) for name in ("unit", "half_extent"))
    known = unit in (None, vocabulary.unit_of_task(task)) or extent is None
    if not known and not math.isclose(extent, env.half_extent, rel_tol=0.01):
        raise ConfigError(
            f"{source} was learned in {unit}, of which a frame shows {extent:g} to each side, but "
            f"{task} shows {env.half_extent:g} of its own: their lengths do not fit"
        )


def with_choices(config: RunConfig, learned: LearnedReward, source: str) -> RunConfig:
    """The configuration with a reward's choices, whatever the task; errors as `configured`."""
    goal = learned.params.goal
    goals = goal.shape[0] if goal.ndim == 2 and num_members(learned.config) == 1 else 1
    head, consistency, pretrain = learned.params.head, config.loss.consistency, config.pretrain
    if head is not None:  # perturbed frames teach distances
        consistency = heads.name_of(head)
        pretrain = dataclasses.replace(pretrain, num_perturbations=0)
    elif ALIGNMENTS[consistency].head:
        consistency = LossConfig.consistency  # any that has no head
    found = dataclasses.replace(
        config,
        encoder=_encoder(config, learned),
        pool=_with(config.pool, learned.activity._asdict()),
        loss=dataclasses.replace(config.loss, goals=goals, consistency=consistency),
        pretrain=pretrain,
    )
    same = setup.encoder_config(found, len(learned.classes)) == learned.config
    rule = PAPER._replace(**found.pool.rule())
    if not same or rule != learned.activity:
        raise ConfigError(
            f"{source} has an encoder or an activity rule that no configuration has, so no policy "
            "can be trained on it here; in code of one's own it works as it is"
        )
    return found


def _encoder(config: RunConfig, learned: LearnedReward):
    """The section `encoder` that makes the reward's encoder."""
    kind = next(n for n, one in ENCODERS.items() if isinstance(learned.config, find(one.config)))
    own = vars(learned.config)
    words = getattr(learned.config, "words", None)
    robot = getattr(learned.config, "pool_robot", False)
    chosen = {"kind": kind, "share_attributes": bool(words), "robot": robot}
    return _with(config.encoder, own | chosen)


def _with(section, values: dict):
    """A section with those of the values that it has fields for."""
    return dataclasses.replace(section, **{n: x for n, x in values.items() if n in vars(section)})
