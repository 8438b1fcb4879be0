"""Styles of scripted episodes of shoes in the box: what differs between two people.

Lengths are metres, speeds m/s, pauses control steps.
"""

from typing import NamedTuple

import numpy as np


class Style(NamedTuple):
    """Parameters of one style."""

    order: tuple[int, int]  # of the shoes; 0 is the nearer one
    lid_speed: float
    carry_speed: float
    arc: float  # height at which a shoe is carried
    detour: tuple[float, float]  # of the middle of the way, x and y
    lid_side: float  # where along its lip the lid is lifted, from the middle
    pauses: tuple[int, ...]  # before the lid, each shoe, each release, and the end
    again: tuple[bool, bool]  # whether each shoe is put down once and taken again
    drops: tuple[tuple[float, float, float], ...]  # where each shoe is let go, in the box's frame
    grip: tuple[float, float]  # where each shoe is taken, along it from its middle


def draw(rng: np.random.Generator) -> Style:
    """Samples a style: half take the farther shoe first, one shoe in ten is taken twice."""
    side = rng.choice([-1, 1])
    return Style(
        order=(0, 1) if rng.random() < 0.5 else (1, 0),
        lid_speed=rng.uniform(0.18, 0.3),
        carry_speed=rng.uniform(0.2, 0.4),
        arc=rng.uniform(0.27, 0.38),
        detour=(rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03)),
        lid_side=rng.uniform(-0.06, 0.02),
        pauses=tuple(int(x) for x in rng.integers(0, 12, 6) * (rng.random(6) < 0.4)),
        again=tuple(bool(x) for x in rng.random(2) < 0.1),
        drops=tuple(
            (rng.uniform(-0.05, 0.03), y + rng.uniform(-0.008, 0.008), rng.uniform(0.12, 0.15))
            for y in (0.04 * side, -0.04 * side)
        ),
        grip=tuple(rng.uniform(-0.015, 0.015, 2)),
    )
