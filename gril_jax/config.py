"""The configuration of a run: its fields, their defaults, their help texts and their ranges.

`RunConfig` nests one frozen dataclass for each concern. The string under a field is its help
text on the command line. A `RunConfig` is checked when it is built, so one that exists is
valid. This is the schema that users see; which numbers a compiled program treats as static and
which as traced is decided by the algorithms' own types. Neither JAX nor MuJoCo is imported
here.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import tyro

from .config_rules import above, at_least, between, rule
from .errors import ConfigError
from .policy_config import PPOConfig, SACConfig

__all__ = [
    "BLOCK_COLOURS",
    "BLOCK_SHAPES",
    "DemosConfig",
    "EncoderConfig",
    "EnvConfig",
    "LossConfig",
    "MakeDemosConfig",
    "PPOConfig",
    "PoolConfig",
    "PretrainConfig",
    "RunConfig",
    "RunSettings",
    "SACConfig",
    "Variant",
    "check",
]

BLOCK_COLOURS = ("red", "green", "blue", "yellow")
BLOCK_SHAPES = ("star", "square", "pentagon", "circle")

Variant = Literal["demo", "jitter", "layout", "color", "shape", "dynamics", "all"]
Places = Literal["demo", "jitter", "layout"]


def _is_block(name: str) -> bool:
    words = name.split(" ")
    return len(words) == 2 and words[0] in BLOCK_COLOURS and words[1] in BLOCK_SHAPES


_BLOCKS = rule(
    lambda names: all(map(_is_block, names)),
    "a list of blocks, each a colour and a shape such as 'green star', with a colour of "
    f"{', '.join(BLOCK_COLOURS)} and a shape of {', '.join(BLOCK_SHAPES)}",
)


@dataclass(frozen=True)
class EnvConfig:
    """The task in the simulator."""

    name: Literal["match_regions", "shoes_in_box"] = "match_regions"
    """The task. Of the options here shoes_in_box takes reward, substeps, iterations and
    episode_length; the others are those of match_regions."""
    robot: Literal["gripper", "short", "medium", "long"] = "gripper"
    """The robot: a gripper with two fingers, or a stick of this length."""
    targets: tuple[str, ...] = field(default=("green star", "green square"), metadata=_BLOCKS)
    """Blocks that belong inside the region, each a colour and a shape."""
    distractors: tuple[str, ...] = field(
        default=("blue pentagon", "yellow circle", "yellow pentagon"), metadata=_BLOCKS
    )
    """Blocks that belong outside the region."""
    variant: Variant = "demo"
    """What is drawn at the start: nothing, places (a little: jitter; anywhere: layout), colours,
    shapes, forces, or the last four (all)."""
    varied_starts: float = field(default=0.5, metadata=between(0, 1))
    """Share of the training episodes that start with the robot anywhere and some targets moved."""
    on_the_way: float = field(default=0.0, metadata=between(0, 1))
    """In those, how likely a target that is not in the region yet is on its way there."""
    facing: float = field(default=0.0, metadata=between(0, 1))
    """In those, how likely the robot stands before such a target, facing it."""
    physics: Literal["xmagical", "magical"] = "xmagical"
    """Whose physics: x-magical's, or the original MAGICAL's, in which blocks coast."""
    engine: Literal["impulse", "mjx"] = "impulse"
    """What solves it: our impulses, or MuJoCo MJX (only the gripper, "xmagical", fixed shapes)."""
    turn: Literal["original", "smooth"] = "original"
    """How an action turns the robot: the original saturating law, or a proportional one."""
    observation: Literal["rich", "sorted", "xmagical"] = "rich"
    """What the policy sees: all that matters; that with the targets in the order in which they are
    due; or x-magical's state vector in its exact order."""
    reward: Literal["S4", "V5", "S3", "sparse", "staged", "stages"] = "S4"
    """The task's own reward, which only `run.reward environmental` learns from: match_regions has
    the first four, shoes_in_box the last three."""
    substeps: int | None = field(
        default=None, metadata=rule(lambda x: x is None or 1 <= x <= 100, "None or from 1 to 100")
    )
    """Physics steps for each control step; None is the engine's own (10, or 5 with mjx)."""
    iterations: int | None = field(
        default=None, metadata=rule(lambda x: x is None or 1 <= x <= 100, "None or from 1 to 100")
    )
    """Sweeps of the solver for each physics step; None is the engine's own (6, or 2 with mjx)."""
    episode_length: int = field(default=120, metadata=at_least(1))
    """Control steps in an episode (8 a second)."""


@dataclass(frozen=True)
class DemosConfig:
    """The demonstrations that the reward is learned from."""

    path: str | None = None
    """Folder of a demonstration set; None makes scripted ones."""
    num: int = field(default=48, metadata=at_least(2))
    """Scripted demonstrations to learn from."""
    num_validation: int = field(default=8, metadata=at_least(1))
    """Scripted demonstrations kept aside to measure the reward."""
    num_failures: int = field(default=8, metadata=at_least(0))
    """Scripted failures, which only measure the reward and never train it."""
    variant: Places = "layout"
    """Where things start in the scripted demonstrations."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the scripted demonstrations."""


@dataclass(frozen=True)
class EncoderConfig:
    """The encoder."""

    kind: Literal["paper", "interaction", "mlp", "pixels"] = "paper"
    """The paper's message passing with weighted pooling, GraphIRL's interaction network or MLP with
    plain mean pooling, or XIRL's ResNet-18 on the frames themselves. Rounds and members belong to
    the first alone, latent to the first and the last. Pixels know no boxes: they learn by temporal
    cycle-consistency alone, and of width, relations, pool_robot, robot_messages, the section pool,
    reconstruction, copies, ascents and touched they use nothing."""
    width: int = field(default=64, metadata=at_least(2))
    """Width of the hidden layers and of a node's embedding; also of the latent of GraphIRL's."""
    rounds: int = field(default=2, metadata=between(0, 16))
    """Rounds of message passing."""
    latent: int = field(default=32, metadata=at_least(1))
    """Width of the latent."""
    pixels: int = field(default=64, metadata=between(16, 1024))
    """Width and height of the frames that pixels see."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """What pixels convolve in: bfloat16 is meant for GPUs. Parameters, statistics and latents are
    float32 in both."""
    relations: bool = False
    """Whether edges also say how far a box sticks out of the other, and is apart from it."""
    distances: bool = True
    """Interaction alone: each class has weights of its own, and nodes know how far the nearest
    object of each class is, as in GraphIRL's robot tasks; if False, nodes are boxes, as in its
    X-MAGICAL tasks, whose objects are all of one class."""
    pool_robot: bool = False
    """Whether the robot's node counts in the pooled latent."""
    robot_messages: bool = False
    """Whether the robot's node sends and receives messages."""
    members: int = field(default=1, metadata=between(1, 100))
    """Networks, each trained by itself; the reward is that of the most pessimistic one."""


@dataclass(frozen=True)
class PoolConfig:
    """Weighted pooling: objects that have moved count more."""

    alpha: float = field(default=5.0, metadata=above(0))
    """Weight of an object that has moved; one that has not weighs 1."""
    tau: float = field(default=0.005, metadata=at_least(0))
    """Displacement within the window that counts as a move, in diagonals of the object's box."""
    window: int = field(default=40, metadata=at_least(1))
    """Frames over which displacement is measured."""
    smoothing: int = field(
        default=1, metadata=rule(lambda x: x >= 1 and x % 2 == 1, "odd and at least 1")
    )
    """Frames of the running median of positions, against single bad detections; 1 for none."""
    noise: float | None = field(
        default=None, metadata=rule(lambda x: x is None or 0 <= x < float("inf"), "at least 0")
    )
    """Standard deviation of a detected position along one axis, world units: what it explains is no
    move. None for exact positions."""


@dataclass(frozen=True)
class LossConfig:
    """The loss that trains the encoder."""

    lambda_: Annotated[float, tyro.conf.arg(name="lambda")] = field(
        default=1.0, metadata=at_least(0)
    )
    """Weight of reconstruction beside temporal cycle-consistency."""
    consistency: Literal["tcc", "soft_dtw", "both"] = "tcc"
    """What aligns videos in time: temporal cycle-consistency, soft-DTW divergence, or the sum."""
    form: Literal["regression_mse", "regression_mse_var", "regression_huber", "classification"] = (
        "regression_mse"
    )
    """Form of temporal cycle-consistency."""
    matching: Literal["deterministic", "stochastic"] = "deterministic"
    """Cycles of every frame through every other video, or as many drawn at random."""
    similarity: Literal["l2", "cosine"] = "l2"
    """Similarity of two latents in temporal cycle-consistency."""
    temperature: float = field(default=1.0, metadata=above(0))
    """Temperature of the soft nearest neighbours in temporal cycle-consistency."""
    soft_dtw_weight: float = field(default=1.0, metadata=at_least(0))
    """Weight of soft-DTW."""
    gamma: float = field(default=0.1, metadata=above(0))
    """Softness of soft-DTW."""
    decoder: Literal["node", "graph"] = "node"
    """What reconstruction decodes: each node's embedding, or the latent."""
    contrast: float = field(default=10.0, metadata=at_least(0))
    """Weight of copies of frames with displaced objects, of which pretrain.copies says how many."""
    near: float = field(default=0.5, metadata=between(0, 1))
    """Share of an object's cost that is due as soon as it is out of place by half its box."""
    idle_cost: float = field(default=0.5, metadata=at_least(0))
    """Cost of what lies where it does not belong, beside that of what is out of place."""
    touch: float = field(default=0.0, metadata=between(0, 1))
    """Share of the cost of what is to be moved that is gone once it has been touched."""
    tail: float = field(default=1.0, metadata=at_least(0))
    """Weight of the fourth power of the copies' errors, beside their squares."""
    span: float = field(default=10.0, metadata=above(0))
    """Latent distance from first to last frames, where there are copies."""
    warmup: int = field(default=1500, metadata=at_least(0))
    """Gradient steps over which a term that aligns times directly fades out; 0 leaves it out."""


@dataclass(frozen=True)
class PretrainConfig:
    """Encoder training."""

    steps: int = field(default=2000, metadata=at_least(1))
    """Gradient steps."""
    learning_rate: float = field(default=1e-3, metadata=above(0))
    """Learning rate of Adam."""
    num_videos: int = field(default=8, metadata=at_least(2))
    """Videos in a batch; each is aligned with each other one."""
    num_frames: int = field(default=32, metadata=at_least(2))
    """Frames sampled from each video of a batch."""
    turn_scenes: bool = True
    """Whether each video of a batch is turned and mirrored at random: eightfold variety."""
    learning_rate_left: float = field(default=1.0, metadata=between(0, 1))
    """Share of the learning rate at the end, reached linearly."""
    copies: int = field(default=0, metadata=between(0, 1000))
    """Copies with displaced objects of each frame that is copied; 0 makes none."""
    anchors: int = field(default=8, metadata=between(1, 1000))
    """Frames of each video of a batch that are copied."""
    ascents: int = field(default=0, metadata=between(0, 100))
    """Steps of each copy towards where the reward overrates it most."""
    touched: float = field(default=0.1, metadata=between(0, 1))
    """Probability that an object of a video counts as moved throughout: no reward for a touch."""


@dataclass(frozen=True)
class RunSettings:
    """The run as a whole."""

    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of everything but the scripted demonstrations."""
    algorithm: Literal["ppo", "sac"] = "ppo"
    """What trains the policy; its options are those of the section of its name."""
    reward: Literal["learned", "environmental", "subtasks", "sum", "shaped"] = "learned"
    """What the policy maximises: the learned reward, the task's own, the chain of the learned
    subtasks, the first two together, or the task's own with the learned one as its potential."""
    reward_weights: tuple[float, float] = field(
        default=(1.0, 0.1),
        metadata=rule(lambda x: all(abs(w) < float("inf") for w in x), "two finite numbers"),
    )
    """Of the learned and of the task's own reward in their sum, or in the shaped one."""
    evaluations: int = field(default=8, metadata=at_least(0))
    """Evaluations while a policy is trained, in the training program itself."""
    out: str | None = field(
        default=None, metadata=rule(lambda x: x is None or bool(x.strip()), "a folder or None")
    )
    """Folder to create for the results; None names one after the time, under runs/."""
    eval_episodes: int = field(default=100, metadata=at_least(1))
    """Episodes of an evaluation."""
    updates_per_chunk: int = field(default=10, metadata=at_least(1))
    """Updates in one compiled call, after which the host logs and may save; changes no result."""
    checkpoint_every: float = field(default=60.0, metadata=at_least(0))
    """Seconds from one checkpoint to the next; 0 saves after each call."""
    keep_checkpoints: int = field(default=3, metadata=at_least(1))
    """Newest checkpoints that stay, for each phase."""
    sinks: tuple[str, ...] = field(
        default=(),
        metadata=rule(
            lambda x: {*x} <= {"tensorboard", "wandb"} and len({*x}) == len(x),
            "a list of tensorboard and wandb, or of one of them",
        ),
    )
    """Where metrics go beside metrics.jsonl: tensorboard, wandb; each is an optional extra."""
    deterministic: bool = False
    """Whether a GPU sums in a fixed order, for the same bits in each run; a CPU always does."""


@dataclass(frozen=True)
class RunConfig:
    """Everything that a run depends on.

    Raises:
      ConfigError: a field is out of its range, or two fields contradict each other.
    """

    env: EnvConfig = EnvConfig()
    demos: DemosConfig = DemosConfig()
    encoder: EncoderConfig = EncoderConfig()
    pool: PoolConfig = PoolConfig()
    loss: LossConfig = LossConfig()
    pretrain: PretrainConfig = PretrainConfig()
    ppo: PPOConfig = field(default=PPOConfig())
    sac: SACConfig = field(default=SACConfig())
    run: RunSettings = RunSettings()

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class MakeDemosConfig:
    """The part of a configuration that scripted demonstrations depend on.

    Raises:
      ConfigError: a field is out of its range, or two fields contradict each other.
    """

    env: EnvConfig = EnvConfig()
    demos: DemosConfig = DemosConfig()

    def __post_init__(self) -> None:
        check(self)


def check(config: RunConfig | MakeDemosConfig) -> None:
    """Raises ConfigError for the first field that is out of range, by its dotted path."""
    for path, value, metadata in _leaves(config, ""):
        if metadata and not metadata["holds"](value):
            shown = list(value) if isinstance(value, tuple) else value
            raise ConfigError(f"{path} is {shown!r}, but must be {metadata['text']}")
    _check_blocks(config.env, config.demos)
    if isinstance(config, RunConfig):
        _check_sizes(config)


def _leaves(config: Any, prefix: str) -> Iterator[tuple[str, Any, Any]]:
    for entry in dataclasses.fields(config):
        value, path = getattr(config, entry.name), f"{prefix}{entry.name}".rstrip("_")
        if dataclasses.is_dataclass(value):
            yield from _leaves(value, f"{path}.")
        else:
            yield path, value, entry.metadata


def _check_blocks(env: EnvConfig, demos: DemosConfig) -> None:
    if not env.targets:
        raise ConfigError("env.targets is empty, but must name at least one block")
    blocks = (*env.targets, *env.distractors)
    twice = next((b for b in blocks if blocks.count(b) > 1), None)
    if twice is not None:
        raise ConfigError(
            f"{twice!r} is named more than once in env.targets and env.distractors, but each "
            "block must have a colour and shape of its own"
        )
    placed = (*EnvConfig.targets, *EnvConfig.distractors)
    stray = next((b for b in blocks if b not in placed), None)
    for path, variant in (("env.variant", env.variant), ("demos.variant", demos.variant)):
        if stray is not None and variant != "layout":
            raise ConfigError(
                f"{stray!r} has no place in the original scene, so {path} is {variant!r}, but "
                "must be 'layout'"
            )


def _check_sizes(config: RunConfig) -> None:
    ppo, demos, pretrain = config.ppo, config.demos, config.pretrain
    if config.encoder.members > 1 and config.encoder.kind != "paper":
        raise ConfigError(
            f"encoder.members is {config.encoder.members}, but must be 1, because encoder.kind is "
            f"{config.encoder.kind!r}"
        )
    if config.encoder.kind == "pixels":
        _check_pixels(config)
    if config.encoder.kind == "mlp":
        if config.loss.decoder == "node":
            raise ConfigError(
                "loss.decoder is 'node', but encoder.kind is 'mlp', which embeds no nodes, so it "
                "must be 'graph'"
            )
        if config.encoder.width % 2:
            raise ConfigError(
                f"encoder.width is {config.encoder.width}, but must be even for encoder.kind 'mlp'"
            )
    if ppo.num_envs % ppo.num_minibatches:
        raise ConfigError(
            f"ppo.num_minibatches is {ppo.num_minibatches}, but must divide ppo.num_envs, "
            f"which is {ppo.num_envs}"
        )
    for name, chosen in (("ppo", ppo), ("sac", config.sac)):
        unroll = chosen.num_envs * chosen.unroll_length
        if chosen.num_timesteps < unroll:
            raise ConfigError(
                f"{name}.num_timesteps is {chosen.num_timesteps}, but must cover one update of "
                f"{name}.num_envs x {name}.unroll_length = {unroll} steps"
            )
    _check_replay(config.sac)
    if demos.path is None and pretrain.num_videos > demos.num:
        raise ConfigError(
            f"pretrain.num_videos is {pretrain.num_videos}, but must be at most demos.num, "
            f"which is {demos.num}"
        )


def _check_pixels(config: RunConfig) -> None:
    """What boxes are needed for is refused where it decides what is learned."""
    run = config.run
    learned = run.reward != "environmental"
    found = {
        "loss.consistency": (config.loss.consistency, config.loss.consistency == "tcc", "'tcc'"),
        "run.reward": (
            run.reward,
            run.reward in ("learned", "environmental", "sum"),
            "'learned', 'environmental' or 'sum'",
        ),
        "sac.relabel": (
            config.sac.relabel,
            not (config.sac.relabel and run.algorithm == "sac" and learned),
            "False",
        ),
    }
    for path, (value, holds, text) in found.items():
        if not holds:
            raise ConfigError(
                f"{path} is {value!r}, but must be {text}, because encoder.kind is 'pixels'"
            )


def _check_replay(sac: SACConfig) -> None:
    unroll = sac.num_envs * sac.unroll_length
    if sac.replay_size % unroll:
        raise ConfigError(
            f"sac.replay_size is {sac.replay_size}, but must be a multiple of sac.num_envs x "
            f"sac.unroll_length = {unroll}, such as {max(1, sac.replay_size // unroll) * unroll}"
        )
    if sac.min_replay > sac.replay_size:
        raise ConfigError(
            f"sac.min_replay is {sac.min_replay}, but must be at most sac.replay_size, which is "
            f"{sac.replay_size}"
        )
