"""What MatchRegions may be asked for: names, physics presets, and the checks of its options."""

import difflib
from typing import NamedTuple

from gril_jax.envs.planar import robots, shapes
from gril_jax.envs.planar.joints import Strengths

from . import layout as layouts
from . import observation as observations
from . import score as rewards

__all__ = [
    "CLASSES",
    "DISTRACTORS",
    "PRESETS",
    "TARGETS",
    "Preset",
    "check_blocks",
    "check_counts",
    "check_engine",
    "check_names",
    "solving",
]

COLOURS, SHAPES = layouts.COLOURS, shapes.SHAPES
CLASSES = ("goal", "robot", *tuple(f"{c} {s}" for c in COLOURS for s in SHAPES))
TARGETS = ("green star", "green square")
DISTRACTORS = ("blue pentagon", "yellow circle", "yellow pentagon")
_SOLVING = {"impulse": (10, 6), "mjx": (5, 2)}  # substeps and iterations of each engine


class Preset(NamedTuple):
    """One of the two simulators' physics."""

    arena: float  # half the side, arena units
    block_mass: float
    strengths: Strengths
    drives: tuple[float, float]  # range of the drive's force in the Dynamics variant
    reverse: float  # fastest backwards, units/s


PRESETS = {
    "xmagical": Preset(1.1, 0.01, Strengths(5.0, 1.0, 4.0, 1.5, 0.1), (3.2, 5.5), 0.8),
    "magical": Preset(1.0, 0.5, Strengths(3.0, 1.0, 4.0, 1.5, 0.1), (2.2, 3.5), 0.6),
}
_KNOWN = {
    "robot": robots.ROBOTS,
    "physics": tuple(PRESETS),
    "engine": tuple(_SOLVING),
    "variant": layouts.VARIANTS,
    "turn": ("original", "smooth"),
    "observation": observations.OBSERVATIONS,
    "reward": rewards.REWARDS,
    "block": CLASSES[2:],
}


def _check(what: str, value: str) -> None:
    known = _KNOWN[what]
    if value not in known:
        close = difflib.get_close_matches(str(value), known, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ValueError(f"{what} is {value!r}, but must be one of {', '.join(known)}{hint}")


def check_names(**options: str) -> None:
    """Raises ValueError for the first option that has no such value."""
    for what, value in options.items():
        _check(what, value)


def check_counts(**options: int) -> None:
    """Raises ValueError for the first count below one."""
    for what, count in options.items():
        if count < 1:
            raise ValueError(f"{what} is {count}, but must be at least 1")


def check_shares(**options: float) -> None:
    """Raises ValueError for the first share that is not between 0 and 1."""
    for what, share in options.items():
        if not 0 <= share <= 1:
            raise ValueError(f"{what} is {share}, but must be between 0 and 1")


def solving(engine: str, substeps: int | None, iterations: int | None) -> tuple[int, int]:
    """Substeps and iterations, the engine's own where they are None; ValueError below one."""
    own = _SOLVING[engine]
    substeps = own[0] if substeps is None else substeps
    iterations = own[1] if iterations is None else iterations
    check_counts(substeps=substeps, iterations=iterations)
    return substeps, iterations


def check_blocks(targets: tuple[str, ...], distractors: tuple[str, ...], variant: str) -> None:
    """Raises ValueError without a target, or for a block that the variant cannot place."""
    if not targets:
        raise ValueError("targets is empty, but needs at least one block")
    for name in (*targets, *distractors):
        _check("block", name)
        if variant not in ("layout", "all") and name not in layouts.DEMO_BLOCKS:
            raise ValueError(f"block {name!r} has no place in the {variant} layout")


def check_engine(engine: str, robot: str, physics: str, variant: str) -> None:
    """Raises ValueError for what the engine "mjx" does not serve."""
    if engine != "mjx":
        return
    if robot != "gripper":
        raise ValueError(f"engine 'mjx' serves the robot 'gripper' only, not {robot!r}")
    if physics != "xmagical":
        raise ValueError(f"engine 'mjx' serves the physics 'xmagical' only, not {physics!r}")
    if variant in ("shape", "all"):
        raise ValueError(f"engine 'mjx' has fixed shapes and cannot serve the variant {variant!r}")
