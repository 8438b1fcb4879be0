"""The end of a demonstration in which nothing happens any more."""

from collections.abc import Sequence

import numpy as np

from .demo import Tracks

_MARGIN = 5  # frames kept after the first in which all blocks have arrived
_MOVING = 0.01  # world units from its final place: an object nearer than this has arrived


def trim_static_tail(
    tracks: Tracks,
    classes: Sequence[str],
    *,
    robots: Sequence[str],
    moving: float = _MOVING,
) -> int:
    """The number of frames to keep: all in which a block is still on its way, and a few more.

    Many equal frames at the end would carry different times, which temporal cycle-consistency
    can only fit by chance. Robot and goal do not count. At least 6 frames are kept if there are.
    A block has arrived once it stays within `moving` of its last place, in the set's unit.
    """
    kinds = [classes[label] for label in tracks.label]
    blocks = [i for i, kind in enumerate(kinds) if kind not in ("goal", *robots)]
    away = np.linalg.norm(tracks.center[:, blocks] - tracks.center[-1:, blocks], axis=-1)
    travelling = np.flatnonzero((away > moving).any(axis=1))
    arrived = int(travelling[-1]) + 1 if len(travelling) else 0
    return min(len(tracks.center), arrived + 1 + _MARGIN)
