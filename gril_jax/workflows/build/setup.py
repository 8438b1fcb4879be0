"""Builds the parts of the experiments from a configuration."""

import contextlib
import dataclasses
import functools
import importlib
import importlib.util
import inspect
import io
import itertools
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import jax
import numpy as np

from gril_jax import envs
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.config.tables import ALIGNMENTS, ENCODERS, alternatives, find
from gril_jax.config.task import NO_TASK
from gril_jax.encoders import encoder, ensemble
from gril_jax.envs import registry
from gril_jax.errors import ConfigError
from gril_jax.export import reward_format
from gril_jax.pretraining import pixel_pretrain, pretrain
from gril_jax.pretraining.arrangement import words_of
from gril_jax.reward.latent_goal import RewardParams

Kind = TypeVar("Kind")


def make_env(config: EnvConfig, *, training: bool, variant: str | None = None) -> envs.Env:
    """The task; varied starts are for training only. ConfigError if it lacks what is asked for."""
    if config.name == NO_TASK:
        raise ConfigError(
            f"env.name is {NO_TASK!r}, but must be a task: a reward can be learned from videos "
            "alone, a policy needs a simulator of the same scene"
        )
    return build(config.name, task_options(config, training=training, variant=variant))


def staged_env(config: EnvConfig, variant: str | None) -> envs.Env:
    """The task for an audit, in a variant in which its stages say what a success is.

    None is the task's own variant, or Demo in place of one whose blocks the stages do not know;
    such a one by its name is a ConfigError."""
    env = make_env(config, training=False, variant=variant)
    if getattr(env, "stages_hold", True):
        return env
    if variant is not None:
        raise ConfigError(
            f"the variant is {variant}, but the stages of {config.name} know the colours, shapes "
            "and number of blocks of Demo alone: audit it in demo, jitter, layout or dynamics"
        )
    return make_env(config, training=False, variant="demo")


def task_of(config: EnvConfig) -> envs.Env | None:
    """The task as demonstrations show it; None where there are videos alone."""
    return None if config.name == NO_TASK else make_env(config, training=False)


def task_options(
    config: EnvConfig, *, training: bool, variant: str | None = None
) -> dict[str, Any]:
    """The options that a task takes of the section `env`: those of its constructor."""
    if config.is_own:
        return _own_options(config, training=training, variant=variant)
    known = envs.options(config.name)
    own = config.own_options
    if stray := next((name for name in own if name not in known), None):
        hint = nearest(stray, known)
        raise ConfigError(f"env.options has {stray}, but {config.name} takes no such option{hint}")
    if config.engine == "warp" and "impl" not in known:
        raise ConfigError(
            f"env.engine is 'warp', but {config.name} has other engines, such as auto"
        )
    near = config.near_starts if training else 0.0
    given = dataclasses.asdict(config) | {
        "variant": variant or config.variant,
        "varied_starts": config.varied_starts if training else 0.0,
        "on_the_way": near, "facing": near, "worlds": config.max_envs,
        "impl": "warp" if config.engine == "warp" else "jax",
    }  # fmt: skip
    del given["options"]
    return {n: value for n, value in given.items() if n in known and value is not None} | own


def _own_options(config: EnvConfig, *, training: bool, variant: str | None) -> dict[str, Any]:
    """The options of a user's own task: those that are meant for it, and fields of `env`.

    Of the section `env` it gets the fields on starts and on its own reward that it accepts."""
    found: dict[str, Any] = {"varied_starts": config.varied_starts if training else 0.0}
    if config.reward is not None:
        found["reward"] = config.reward
    asked = variant or config.variant
    with _one_sentence():
        known, varies = envs.options(config.name), registry.accepts(config.name, "variant")
    found = {name: value for name, value in found.items() if name in known} | config.own_options
    if asked == EnvConfig.variant:  # nothing is asked for
        return found
    if not varies:
        raise ConfigError(
            f"the variant is {asked!r}, but {config.shown_name} takes no option variant"
        )
    return found | {"variant": asked}


@contextlib.contextmanager
def _one_sentence() -> Iterator[None]:
    """Turns a task's ValueError into a ConfigError."""
    try:
        yield
    except ValueError as error:
        raise ConfigError(f"env: {error}") from error


def build(task: str, options: Mapping[str, Any]) -> envs.Env:
    """The task with these options; ConfigError if one is out of range."""
    if options.get("impl") == "warp" and importlib.util.find_spec("warp") is not None:
        # Or Warp reports on each of its kernels; the task says if it is not installed.
        warp = importlib.import_module("warp")
        warp.config.log_level = warp.LOG_WARNING
    with _one_sentence(), contextlib.redirect_stdout(io.StringIO()):  # mjx reports optional parts
        return registry.build(task, options)


def encoder_config(config: RunConfig, num_classes: int) -> encoder.AnyConfig:
    """The encoder's sizes and options."""
    chosen = find(ENCODERS[config.encoder.kind].config).of(config.encoder, num_classes)
    if not config.encoder.share_attributes or not isinstance(chosen, encoder.EncoderConfig):
        return chosen
    if config.env.name == NO_TASK:
        raise ConfigError(
            "encoder.share_attributes is True, but must be False where there is no task"
        )
    return dataclasses.replace(chosen, words=_words(config.env))


@functools.cache
def _words(config: EnvConfig) -> tuple[int, ...]:
    """First and last word of each class's name of a task."""
    return tuple(itertools.chain(*words_of(make_env(config, training=False).classes)))


def by_name(kind: type[Kind], *sections: Any, **more: Any) -> Kind:
    """A library's option type with every field from the section that has it, or from `more`; other
    fields keep their defaults."""
    known = {name: value for section in sections for name, value in vars(section).items()} | more
    names = inspect.signature(kind).parameters
    return kind(**{name: known[name] for name in names if name in known})


def pretrain_config(config: RunConfig, classes: Sequence[str]) -> pretrain.Static:
    """The static options of training on boxes of these classes; `updates` is one call's share of
    all steps."""
    return dataclasses.replace(embedding_config(config, len(classes)), words=words_of(classes))


def embedding_config(config: RunConfig, num_classes: int) -> pretrain.Static:
    """The static options of embedding alone, which does not ask what the classes are called."""
    require_boxes(config, "training on boxes")
    return by_name(
        pretrain.Static, config.loss, config.pool, config.pretrain,
        encoder=encoder_config(config, num_classes), updates=_updates(config),
        **config.pool.rule(),
    )  # fmt: skip


def pixel_pretrain_config(config: RunConfig) -> pixel_pretrain.PixelStatic:
    """The static options of training for an encoder of pictures."""
    return by_name(
        pixel_pretrain.PixelStatic, config.loss, config.pretrain,
        encoder=encoder_config(config, 0), updates=_updates(config),
    )  # fmt: skip


def _updates(config: RunConfig) -> int:
    return next(n for n in (100, 50, 20, 10, 5, 2, 1) if config.pretrain.steps % n == 0)


def picture_border(pixels: int) -> int:
    """Pixels to cut off each side of a picture: the arena's wall.

    It is drawn broader in the videos than on the device, and would tell one from the other.
    """
    return max(1, round(pixels / 64))


def seen_half_extent(env: envs.Env, pixels: int) -> float:
    """Half extent of what an encoder of pictures sees: without the border."""
    return env.half_extent * pixels / (pixels + 2 * picture_border(pixels))


def require_boxes(config: RunConfig, purpose: str) -> None:
    """Raises ConfigError if the encoder takes pictures, but the purpose needs objects' boxes."""
    if not ENCODERS[config.encoder.kind].boxes:
        of_boxes = alternatives([name for name, one in ENCODERS.items() if one.boxes])
        raise ConfigError(
            f"encoder.kind is {config.encoder.kind!r}, but must be {of_boxes} for {purpose}"
        )


def pretrain_hyper(config: RunConfig) -> pretrain.Hyper:
    """The traced hyper-parameters of encoder training."""
    found = by_name(
        pretrain.Hyper, config.loss, config.pool, config.pretrain,
        decay_updates=config.pretrain.steps,
    )  # fmt: skip
    return pretrain.Hyper(*map(float, found))


def reward_form(config: RunConfig, num_classes: int) -> Hashable:
    """Equal for configurations whose rewards have parameters of the same shapes."""
    head = ALIGNMENTS[config.loss.consistency].head
    return encoder_config(config, num_classes), config.loss.goals, head


def blank_reward(config: RunConfig, num_classes: int) -> RewardParams:
    """Reward parameters of the right shapes, to restore a checkpoint into."""
    chosen = encoder_config(config, num_classes)
    members = ensemble.num_members(chosen)
    shapes = jax.eval_shape(lambda: encoder.init(jax.random.key(0), chosen))
    blank = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), shapes)
    latent = ensemble.latent_size(chosen)
    several = config.loss.goals > 1 and ENCODERS[config.encoder.kind].boxes
    goal = (config.loss.goals, latent) if several else (latent,)
    goal, scale, alpha = (
        np.zeros(shape, np.float32) for shape in (goal, members if members > 1 else (), ())
    )
    head, start = None, None
    if ALIGNMENTS[config.loss.consistency].head:
        shapes = reward_format.blank_head(config.loss.consistency, latent)
        head = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), shapes)
        start = np.zeros(latent, np.float32)
    found = RewardParams(blank, goal, scale, alpha, head, start)
    return jax.device_put(found)  # nothing is compiled


def device_in_words() -> str:
    """The devices that JAX uses, such as "2 x cpu"."""
    devices = jax.devices()
    return f"{len(devices)} x {devices[0].device_kind}"
