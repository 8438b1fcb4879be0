"""Marks of scripted failures: positions alone show that an episode is one of its kind.

Each mark reads the things' places (T, 2 shoes), the lid's angle (T,), and which shoes are in at the
end. A script that slips makes another failure than it meant to; such episodes are not used.
"""

import numpy as np
from jaxtyping import Bool, Float

from . import model

_SHUT, _OPENED = 0.1, 1.571  # rad
_OFF_TABLE = 0.1  # metres: the centre of a carried shoe
_ON_LID = (0.17, 0.25)  # metres: the centre of a shoe that lies on the closed lid
_FAR = 0.1  # metres


def shows(
    kind: str,
    shoes: Float[np.ndarray, "T 2 3"],
    lid: Float[np.ndarray, "T"],
    inside: Bool[np.ndarray, "2"],
    box: Float[np.ndarray, "2"],
) -> bool:
    """True if an episode that is no success shows this kind of failure.

    Shoes and box are given by their centres in metres, the lid by its angle in rad.
    """
    number, opened = int(inside.sum()), bool((lid > _OPENED).any())
    lifted = shoes[:, :, 2].max(axis=0) > _OFF_TABLE
    away = np.linalg.norm(shoes[-1, :, :2] - shoes[0, :, :2], axis=1)
    if kind == "lid only":
        return bool(lid[-1] > _OPENED) and number == 0 and not lifted.any()
    if kind == "one shoe":
        return opened and number == 1 and not lifted[~inside].any()
    if kind == "shoe outside":
        down = shoes[-1, ~inside, 2] < _OFF_TABLE
        return opened and number == 1 and bool(lifted.all() and down.all())
    if kind == "lid closed again":
        return opened and bool(lid[-1] < _SHUT)
    if kind == "wrong order":
        over = np.linalg.norm(shoes[:, :, :2] - box, axis=2) < model.BOX_HALF[0]
        on = over & (shoes[:, :, 2] > _ON_LID[0]) & (shoes[:, :, 2] < _ON_LID[1])
        return bool((on & (lid < _SHUT)[:, None]).any())
    if kind == "shoe knocked away":
        return number == 1 and not lifted[~inside].any() and bool((away[~inside] > _FAR).all())
    return kind == "stops early"
