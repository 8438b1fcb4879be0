"""Phrases for frames of a demonstration: the objects that start to move or come to rest there."""

from collections.abc import Sequence

import numpy as np

from gril_jax.demos.demo import Tracks
from gril_jax.demos.schema import ROBOTS

_FRAMES = 4  # before and after, in which something moves or rests
_MOVES = 0.1  # of its box's diagonal, in so many frames; less is the detector's jitter


def at_frames(
    tracks: Tracks, frames: Sequence[int], classes: Sequence[str], robots: Sequence[str] = ROBOTS
) -> list[str]:
    """A phrase for each frame, such as "the green square comes to rest"; robots do not count."""
    names = [classes[label] for label in tracks.label]
    counted = [i for i, name in enumerate(names) if name not in robots]
    return [_at(tracks.of(counted), frame, [names[i] for i in counted]) for frame in frames]


def _at(tracks: Tracks, frame: int, names: Sequence[str]) -> str:
    last = len(tracks.center) - 1
    before, after = max(frame - _FRAMES, 0), min(frame + _FRAMES, last)
    enough = _MOVES * np.linalg.norm(tracks.size[frame], axis=1)
    here = tracks.center[frame]
    came = np.linalg.norm(here - tracks.center[before], axis=1) > enough
    goes = np.linalg.norm(tracks.center[after] - here, axis=1) > enough
    kinds = {
        "comes to rest": came & ~goes,
        "starts to move": ~came & goes,
        "is on its way": came & goes,
    }
    said = [
        f"the {name} {words}"
        for words, which in kinds.items()
        for name, holds in zip(names, which, strict=True)
        if holds
    ]
    return " and ".join(said) if said else "nothing moves but the robot, if that does"
