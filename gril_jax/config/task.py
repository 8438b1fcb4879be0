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
NO_TASK = "none"  # of a run that learns a reward from films alone
Variant = Literal["demo", "jitter", "layout", "color", "shape", "countplus", "dynamics", "all"]
Places = Literal["demo", "jitter", "layout"]  # of scripted demonstrations

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
    """The task: one of gril's own, a file of yours and the function that makes it, such as
    my_task.py:make, an entry point of `gril_jax.tasks`, or the import path of a TaskSpec. It takes
    those of the options here that its constructor has; others do nothing. none is for a
    reward from films alone, whose classes, units and frame rate the demonstration set has."""
    targets: tuple[str, ...] = field(default=("green star", "green square"), metadata=_BLOCKS)
    """Blocks that belong inside the region, each a colour and a shape."""
    distractors: tuple[str, ...] = field(
        default=("blue pentagon", "yellow circle", "yellow pentagon"), metadata=_BLOCKS
    )
    """Blocks that belong outside the region."""
    variant: Variant = "demo"
    """Quantities randomised at the start: nothing, places (a little: jitter; anywhere: layout),
    colours, shapes, these three and the number of blocks (countplus), forces, or all of that that
    the task varies (all)."""
    varied_starts: float = field(default=0.5, metadata=between(0, 1))
    """Share of the training episodes that start with the robot anywhere and some targets moved, or
    for a task on a table at a moment of a scripted expert's."""
    near_starts: float = field(default=0.0, metadata=between(0, 1))
    """In those, the probability that a target outside the region starts on its way there; also that
    the robot stands before such a target, facing it."""
    engine: Literal["auto", "kernel", "impulse", "mjx", "warp"] = "auto"
    """Physics solver: our impulses in one NVIDIA Warp kernel; the same in JAX, which has gradients
    and is many times slower; MuJoCo MJX (only the gripper, "xmagical", fixed shapes); or, of a task
    on a table, MuJoCo Warp where that is installed. auto is the kernel on CPUs and NVIDIA GPUs and
    impulse elsewhere, and MJX on a table."""
    observation: Literal["plain", "rich", "sorted", "xmagical"] = "rich"
    """The policy's observation: poses and velocities; also which blocks are in the region; the same
    with the targets in the order in which they are due; or x-magical's state vector in its exact
    order. Of a task on a table: plain, or rich with the stages that have been reached."""
    reward: str | None = None
    """The task's own reward, which only `run.reward environmental` learns from: match_regions has
    S4, V5, sparse, a task on a table staged, stages, sparse, MAGICAL's others sparse; None is
    the first."""
    max_envs: int = field(default=4096, metadata=at_least(1))
    """With the engine warp, the most environments stepped together, counting all seeds of a
    program: their contacts share one table."""
    episode_length: int | None = field(default=None, metadata=optional(_LENGTH))
    """Control steps in an episode; None is the task's own: 120 of match_regions, 8 a second."""
    options: tuple[str, ...] = field(default=(), metadata=_PAIRS)
    """Further options of the task, each NAME=VALUE: keyword arguments of the function or class that
    makes it, such as robot=short or physics=magical of MatchRegions."""

    def check(self) -> None:
        """Raises ConfigError if there is no such task, or if it has no such reward."""
        if self.name == NO_TASK:
            return
        try:
            registry.check(self.name, self.reward)
        except ValueError as error:
            raise ConfigError(f"env: {error}") from None

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
    """Folder of a demonstration set; None makes scripted ones."""
    num: int = field(default=48, metadata=at_least(2))
    """Scripted demonstrations to learn from."""
    num_validation: int = field(default=8, metadata=at_least(1))
    """Held-out demonstrations to measure the reward; of those at demos.path a quarter at most."""
    num_failures: int = field(default=8, metadata=at_least(0))
    """Scripted failures, which only measure the reward and never train it."""
