"""The configuration of a run: its fields, their defaults, their help texts and their ranges.

`RunConfig` nests one frozen dataclass for each concern; it is checked when it is built. The string
under a field is its help text on the command line. Which numbers a compiled program treats as
static and which as traced is decided by the algorithms' own types. JAX is not imported here.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated, Any, Literal

import tyro

from gril_jax.errors import ConfigError

from .command_line import RunFolder, short
from .encoder import EncoderOptions, PoolConfig
from .reward import LossConfig, PretrainConfig
from .tables import (
    ALGORITHMS,
    ALIGNMENTS,
    ENCODERS,
    REWARDS,
    alternatives,
    at_least,
    between,
    count,
    find,
    optional,
    require,
    rule,
)
from .task import DemosConfig, EnvConfig

Section = tyro.conf.FlagConversionOff  # True and False are written out, as in YAML


@dataclass(frozen=True)
class RunSettings:
    """Settings of the whole run."""

    seed: Annotated[int, short("--seed")] = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of everything but the scripted demonstrations."""
    algorithm: Annotated[Literal[*ALGORITHMS], short("--algorithm")] = "ppo"
    """Algorithm that trains the policy. Its options are in the section of its name."""
    reward: Annotated[str, short("--reward")] = field(
        default="learned",
        metadata=rule(
            lambda x: x in REWARDS or "/" in x or x.endswith(".npz"),
            f"{alternatives([*REWARDS])}, or the file or run of a reward that has been learned",
        ),
    )
    """Reward of the policy: learned, environmental (the task's own), stages (the learned one in
    stages), shaped (the task's own with the learned one as potential), or the file or run of a
    learned reward."""
    reward_offset: float = field(default=0.0, metadata=rule(isfinite, "a finite number"))
    """Constant that is added to the learned reward. With 1 the reward begins at about 0."""
    audit: int = field(default=0, metadata=at_least(0))
    """Gradient searches of the audit after training. 0 makes no audit."""
    evaluations: int = field(default=8, metadata=at_least(0))
    """Evaluations during policy training, in num_timesteps of the algorithm."""
    max_steps: Annotated[int | None, short("--max-steps")] = field(
        default=None, metadata=optional(at_least(1))
    )
    """Environment steps at most. Training goes on after num_timesteps until evaluations have not
    improved for a fifth of the steps; it ends at once if they succeed. The best policy is kept.
    None, or no evaluations, end it at num_timesteps."""
    out: Annotated[str | None, short("--out")] = field(
        default=None, metadata=optional(rule(str.strip, "a folder or None"))
    )
    """Folder to create for the results. None makes one under runs/."""
    eval_episodes: int = field(default=256, metadata=at_least(1))
    """Initial states of an evaluation. Each is played with deterministic and sampled actions."""
    updates_per_chunk: int = field(default=10, metadata=at_least(1))
    """Updates between two rows of metrics. The run saves and can be stopped between them, too."""
    checkpoint_every: float = field(default=60.0, metadata=at_least(0))
    """Seconds between two checkpoints. 0 saves after each call."""
    sinks: tuple[str, ...] = field(
        default=(),
        metadata=rule(
            lambda x: {*x} <= {"tensorboard", "wandb"} and len({*x}) == len(x),
            "a list of tensorboard and wandb, or of one of them",
        ),
    )
    """Further places for metrics: tensorboard, wandb. Each is an optional extra."""

    @property
    def reward_form(self) -> str:
        """The form of the reward, of `REWARDS`; that of one learned before is "learned"."""
        return self.reward if self.reward in REWARDS else "learned"

    @property
    def reward_source(self) -> str | None:
        """The file or folder of a reward that has been learned before; None for any other."""
        return None if self.reward in REWARDS else self.reward


@dataclass(frozen=True)
class DemoSections:
    """The sections that scripted demonstrations depend on, as they are given: not checked."""

    env: Section[EnvConfig] = field(default=EnvConfig())
    demos: Section[DemosConfig] = field(default=DemosConfig())


@dataclass(frozen=True)
class RewardSections(DemoSections):
    """Those that a learned reward depends on."""

    encoder: Section[EncoderOptions] = field(default=EncoderOptions())
    pool: Section[PoolConfig] = field(default=PoolConfig())
    loss: Section[LossConfig] = field(default=LossConfig())
    pretrain: Section[PretrainConfig] = field(default=PretrainConfig())
    run: Section[RunSettings] = field(default=RunSettings())


_SECTIONS = {name: find(one.options) for name, one in ALGORITHMS.items()}

# With one section more for each algorithm.
Sections = dataclasses.make_dataclass(
    "Sections",
    [(name, Section[kind], kind()) for name, kind in _SECTIONS.items()],
    bases=(RewardSections,),
    namespace={"__doc__": "All sections, as they are given.", "__module__": __name__},
    frozen=True,
)


@dataclass(frozen=True)
class MakeDemosConfig(DemoSections):
    """The part of a configuration that scripted demonstrations depend on; a ConfigError if a field
    is out of its range, or two contradict each other."""

    def __post_init__(self) -> None:
        check(self)

    @classmethod
    def of(cls, given: DemoSections) -> Any:
        """The sections that belong here, checked."""
        return cls(**{field.name: getattr(given, field.name) for field in dataclasses.fields(cls)})


@dataclass(frozen=True)
class RunConfig(MakeDemosConfig, Sections):
    """All settings that a run depends on."""

    @property
    def sub_policies(self) -> int:
        """Networks of the policy: more than one only for PPO on a reward in stages."""
        staged = REWARDS[self.run.reward_form].staged and self.run.algorithm == "ppo"
        return self.ppo.sub_policies if staged else 1


def check(config: DemoSections) -> None:
    """Raises ConfigError for the first field that is out of range, with its dotted path."""
    for path, value, metadata in _leaves(config, ""):
        require(path, value, metadata)
    config.env.check()
    _check_blocks(config.env)
    if isinstance(config, Sections):
        _check_sizes(config)


def _leaves(config: Any, prefix: str) -> Iterator[tuple[str, Any, Any]]:
    for entry in dataclasses.fields(config):
        value, path = getattr(config, entry.name), f"{prefix}{entry.name}".rstrip("_")
        if dataclasses.is_dataclass(value):
            yield from _leaves(value, f"{path}.")
        else:
            yield path, value, entry.metadata


def _check_blocks(env: EnvConfig) -> None:
    if not env.targets:
        raise ConfigError("env.targets is empty, but must name at least one block")
    blocks = (*env.targets, *env.distractors)
    twice = next((b for b in blocks if blocks.count(b) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"{twice!r} is named more than once in env.targets and env.distractors, but each "
            "block must have a colour and shape of its own"
        )
    env.require_places("env.variant", env.variant)


def _check_sizes(config: RunConfig) -> None:
    demos, pretrain, env = config.demos, config.pretrain, config.env
    _check_encoder(config)
    _check_consistency(config)
    for name in ALGORITHMS:
        getattr(config, name).check(name)
    at_once = {
        f"{config.run.algorithm}.num_envs": getattr(config, config.run.algorithm).num_envs,
        "run.eval_episodes": config.run.eval_episodes,
    }
    for path, number in at_once.items():
        if env.engine == "warp" and env.max_envs < number:
            raise ConfigError(
                f"env.max_envs is {env.max_envs}, but must be at least {path}, which is {number}"
            )
    if demos.path is None and pretrain.num_videos > demos.num:
        raise ConfigError(
            f"pretrain.num_videos is {pretrain.num_videos}, but must be at most demos.num, "
            f"which is {demos.num}"
        )


def _check_encoder(config: RunConfig) -> None:
    encoder, kind = config.encoder, ENCODERS[config.encoder.kind]
    size = encoder.ensemble_size
    found = {"encoder.ensemble_size": (size, size == 1 or kind.ensembles, "1")}
    if not kind.boxes:
        found |= _of_pictures(config)
    for path, (value, holds, text) in found.items():
        if not holds:
            raise ConfigError(
                f"{path} is {value!r}, but must be {text}, because encoder.kind is {encoder.kind!r}"
            )
    if kind.boxes and config.loss.decoder == "node" and not kind.nodes:
        raise ConfigError(
            f"loss.decoder is 'node', but encoder.kind is {encoder.kind!r}, which embeds no nodes, "
            "so it must be 'graph'"
        )
    if encoder.width % 2 and kind.even:
        raise ConfigError(
            f"encoder.width is {encoder.width}, but must be even for encoder.kind {encoder.kind!r}"
        )


def _check_consistency(config: RunConfig) -> None:
    """A method that predicts progress has no distances to teach, and soft-DTW needs one order."""
    loss, chosen = config.loss, ALIGNMENTS[config.loss.consistency]
    found = {}
    if chosen.head:
        found = {
            "encoder.ensemble_size": (config.encoder.ensemble_size, 1),
            "loss.goals": (loss.goals, 1),
            "pretrain.num_perturbations": (config.pretrain.num_perturbations, 0),
        }
    if any(one.endswith(".warping") for one in chosen.losses):
        found = {"pretrain.rewind": (config.pretrain.rewind, 0)}
    for path, (value, needed) in found.items():
        if value != needed:
            raise ConfigError(
                f"{path} is {value!r}, but must be {needed}, because loss.consistency is "
                f"{loss.consistency!r}"
            )


def _of_pictures(config: RunConfig) -> dict[str, tuple[Any, bool, str]]:
    """Choices that may need boxes: their values, whether pixels do, and what else they must be."""
    run, form = config.run, REWARDS[config.run.reward_form]
    with_pictures = alternatives([name for name, one in REWARDS.items() if one.pictures])
    return {
        "loss.consistency": (
            config.loss.consistency,
            config.loss.consistency.startswith("tcc"),
            alternatives([name for name in ALIGNMENTS if name.startswith("tcc")]),
        ),
        "run.reward": (run.reward, form.pictures, with_pictures),
        "pretrain.rewind": (config.pretrain.rewind, config.pretrain.rewind == 0, "0"),
    }


@dataclass(frozen=True)
class StageOptions:
    """The run, and how its stages are found; see `gril_jax.subtasks.agreement`."""

    run: RunFolder
    """Folder of a run that has learned a reward."""
    out: str | None = None
    """New folder for the results; None for `subtasks` in the run's folder."""
    prominence: float = field(default=0.125, metadata=rule(lambda x: x > 0, "above 0"))
    """Least height of a stage's rise; a learned reward goes from about -1 to 0."""
    smoothing: int = field(
        default=15, metadata=rule(lambda x: x >= 1 and x % 2 == 1, "odd and at least 1")
    )
    """Frames of the running median of the reward, odd."""
    patience: int | None = field(default=None, metadata=optional(count()))
    """Frames without progress that end a stage; None finds it from the demonstrations."""
    support: float = field(
        default=0.5, metadata=rule(lambda x: 0 < x <= 1, "above 0 and at most 1")
    )
    """Least share of the demonstrations that must each show a stage's end."""
    videos: bool = False
    """Write each segment as a video of its own, `videos/NAME-1.mp4` and so on."""
    lerobot: str | None = None
    """A LeRobot dataset from which the videos were imported; a copy of it with the segments as
    subtask annotations goes to `lerobot` in the results."""
    sets: bool = False
    """Write each subtask's demonstrations as a separate set, videos included."""
    demos: str | None = None
    """Folder of the run's demonstration set now; None: where it was, or beside the run."""
    task: str | None = None
    """A task of your own whose file has been moved, such as my_task.py:make; None: where it was."""


def is_one_network(config: RunConfig) -> bool:
    """True if a policy file can hold the policy."""
    try:
        require_one_network(config)
    except ConfigError:
        return False
    return True


def require_one_network(config: RunConfig) -> None:
    """Raises ConfigError if a policy is more than one plain network, which no policy file holds."""
    algorithm, ppo = config.run.algorithm, config.ppo
    faults = {
        f"sees the gradient of its reward ({algorithm}.observe_gradient is true), but a policy "
        "file holds no reward": getattr(config, algorithm).observe_gradient,
        f"is {config.sub_policies} sub-policies, chosen by the learned reward's stages, but a "
        "policy file holds one network": config.sub_policies > 1,
        "reads its observation object by object (ppo.by_object is true), but a policy file holds "
        "plain layers": algorithm == "ppo" and ppo.by_object,
    }
    for fault, holds in faults.items():
        if holds:
            raise ConfigError(
                f"the policy {fault}: act with policy.actor() or "
                "gril_jax.load_policy(RUN).actor() in Python"
            )
