"""The sections `env` and `demos` of a run's configuration: the task, and its demonstrations."""

import json
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from gril_jax.envs import registry
from gril_jax.errors import ConfigError

from .command_line import short
from .tables import at_least, between, optional, rule

BLOCK_COLOURS = ("red", "green", "blue", "yellow")
BLOCK_SHAPES = ("star", "square", "pentagon", "circle")

TaskName = str  # `EnvConfig` checks it against the registry
NO_TASK = "none"  # of a run that learns a reward from videos alone
VARIANTS = ("demo", "jitter", "layout", "color", "shape", "countplus", "dynamics", "all")
PLACES = ("demo", "jitter", "layout")  # those of scripted demonstrations

_BLOCKS = rule(
    lambda names: {*names} <= {f"{c} {s}" for c in BLOCK_COLOURS for s in BLOCK_SHAPES},
    "a list of blocks, each a colour and a shape such as 'green star', with a colour of "
    f"{', '.join(BLOCK_COLOURS)} and a shape of {', '.join(BLOCK_SHAPES)}",
)
_PAIRS = rule(
    lambda pairs: (
        all(pair.partition("=")[0].isidentifier() and "=" in pair for pair in pairs)
        and len({pair.partition("=")[0] for pair in pairs}) == len(pairs)
    ),
    "a list of NAME=VALUE, each name once",
)
_LENGTH = rule(lambda x: x >= 1, "None or at least 1")


@dataclass(frozen=True)
class EnvConfig:
    """The task in the simulator."""

    name: Annotated[TaskName, short("--task")] = "match_regions"
    """The task: a name that `gril` lists, a file of yours and its function (my_task.py:make), an
    entry point of `gril_jax.tasks`, or the import path of a TaskSpec. `none` learns a reward
    from videos alone."""
    targets: tuple[str, ...] = field(default=("green star", "green square"), metadata=_BLOCKS)
    """Blocks that belong inside the region, each a colour and a shape."""
    distractors: tuple[str, ...] = field(
        default=("blue pentagon", "yellow circle", "yellow pentagon"), metadata=_BLOCKS
    )
    """Blocks that belong outside the region."""
    variant: str = "demo"
    """Randomness of the initial state: nothing (demo), places by a little (jitter) or anywhere
    (layout), colours (color), shapes (shape), these three and the number of blocks (countplus),
    forces (dynamics), or all of it (all). A task of yours has variants of its own."""
    varied_starts: float = field(default=0.5, metadata=between(0, 1))
    """Fraction of training episodes with a helpful initial state: the robot anywhere and some
    targets moved, or a state of the scripted expert's episodes (table tasks)."""
    near_starts: float = field(default=0.0, metadata=between(0, 1))
    """In those episodes, the probability that a target is on its way to the region, and that the
    robot faces such a target."""
    engine: Literal["auto", "kernel", "impulse", "mjx", "warp"] = "auto"
    """Physics: our solver in an NVIDIA Warp kernel (kernel), the same in JAX with gradients
    (impulse), MuJoCo MJX (mjx), or MuJoCo Warp for table tasks (warp). auto takes kernel on CPUs
    and NVIDIA GPUs, else impulse, and mjx for table tasks."""
    observation: Literal["plain", "rich", "sorted", "objects", "xmagical"] = "rich"
    """What the policy sees: poses and velocities (plain); also which blocks are in the region, or
    which stages hold (rich); the same with the next target first (sorted); poses, velocities,
    colours and shapes, a row for each object (objects); or x-magical's state vector (xmagical)."""
    reward: str | None = None
    """The task's own reward, for `--reward environmental`: S4, V5 or sparse (match_regions),
    staged, stages or sparse (table tasks), sparse (MAGICAL's other tasks). None is the first."""
    max_envs: int = field(default=4096, metadata=at_least(1))
    """With engine warp, the most environments in one program, over all seeds."""
    episode_length: int | None = field(default=None, metadata=optional(_LENGTH))
    """Control steps in an episode. None is the task's own."""
    options: tuple[str, ...] = field(default=(), metadata=_PAIRS)
    """Keyword arguments of the task's constructor, each NAME=VALUE, such as robot=short."""

    def check(self) -> None:
        """Raises ConfigError if there is no such task, or if it has no such reward or variant."""
        if self.name == NO_TASK:
            return
        self.require_variant("env.variant", self.variant)
        try:
            registry.check(self.name, self.reward)
        except ValueError as error:
            raise ConfigError(f"env: {error}") from None

    def require_variant(
        self, option: str, variant: str | None, known: tuple[str, ...] = VARIANTS
    ) -> None:
        """Raises ConfigError if no task of this package has a variant, which the option names."""
        if variant is not None and variant not in known and not self.is_own:
            raise ConfigError(f"{option} is {variant!r}, but must be one of {', '.join(known)}")

    def require_places(self, option: str, variant: str) -> None:
        """Raises ConfigError if a variant, which the option names, has no places for the blocks."""
        placed = (*EnvConfig.targets, *EnvConfig.distractors)
        stray = next((b for b in (*self.targets, *self.distractors) if b not in placed), None)
        if stray is not None and variant != "layout":
            raise ConfigError(
                f"{stray!r} has no place in the original scene, so {option} is {variant!r}, but "
                "must be 'layout'"
            )

    @property
    def is_own(self) -> bool:
        """True if the task is a user's own: a file's or an entry point's."""
        return registry.is_own(self.name)

    @property
    def digest(self) -> str | None:
        """The SHA-256 of the file that the task is of; None if it is of none."""
        return registry.digest(self.name)

    @property
    def shown_name(self) -> str:
        """The task's name for people."""
        return registry.shown_name(self.name)

    @property
    def own_options(self) -> dict[str, Any]:
        """The keyword arguments in `options`: numbers, True, False, None and JSON, or else text."""
        pairs = (pair.partition("=") for pair in self.options)
        return {name: _value(text) for name, _, text in pairs}


def _value(text: str) -> Any:
    try:
        return json.loads({"True": "true", "False": "false", "None": "null"}.get(text, text))
    except ValueError:
        return text


@dataclass(frozen=True)
class DemosConfig:
    """The demonstrations that the reward is learned from."""

    path: Annotated[str | None, short("--demos")] = None
    """Folder of a demonstration set. None records the task's scripted expert."""
    num: int = field(default=48, metadata=at_least(2))
    """Scripted demonstrations to learn from."""
    num_validation: int = field(default=8, metadata=at_least(1))
    """Demonstrations that are held out to measure the reward; of your own set a quarter at most."""
    num_failures: int = field(default=8, metadata=at_least(0))
    """Scripted failures, which measure the reward and never train it."""
