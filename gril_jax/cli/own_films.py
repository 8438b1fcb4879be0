"""Settings of a run that the demonstration set of somebody's own films decides.

A set without a task has its own classes, unit and frame rate. The run's configuration then takes
from the set what depends on them, unless the command line says otherwise.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any, TypeVar

from gril_jax.config.run_config import Sections
from gril_jax.errors import DemoError, RunError
from gril_jax.safe_files import read_object

CONFIG = "own_videos"
_TOGETHER = 4  # films of a batch, at most
_WINDOW = 4.0  # seconds that a displacement is measured over

Given = TypeVar("Given", bound=Sections)


def header(folder: str | None) -> dict[str, Any] | None:
    """The header of a demonstration set; None where there is none, which is left to who looks at
    the set later."""
    try:
        return None if folder is None else read_object(Path(folder) / "demos.json")
    except RunError as error:
        raise DemoError(str(error)) from None
    except OSError:
        return None


def with_noise(given: Given) -> Given:
    """The sections with how much the set's boxes jitter, unless they say it: else any jitter would
    count as motion."""
    found = header(given.demos.path) or {}
    if given.pool.noise is not None or not isinstance(found.get("noise"), float):
        return given
    pool = _replaced(given.pool, noise=found["noise"])
    return dataclasses.replace(given, pool=pool)


def with_units(given: Given, found: dict[str, Any]) -> Given:
    """The sections with what depends on a set's units, as far as its header has them."""
    half, rate = found.get("half_extent"), found.get("fps")
    is_rate = type(rate) in (int, float) and 0 < rate < 1e6
    listed = found.get("demos")
    demos = [one for one in (listed if isinstance(listed, list) else ()) if isinstance(one, dict)]
    good = [one for one in demos if one.get("outcome") != "failure"]
    together = max(2, min(_TOGETHER, len(good) - math.ceil(len(good) / 4)))
    return dataclasses.replace(
        given,
        encoder=_replaced(
            given.encoder, length_unit=float(half) if type(half) in (int, float) else None
        ),
        pool=_replaced(given.pool, window=max(1, round(_WINDOW * rate)) if is_rate else None),
        pretrain=_replaced(given.pretrain, num_videos=together),
    )


def _replaced(section: Any, **values: Any) -> Any:
    return dataclasses.replace(section, **{k: v for k, v in values.items() if v is not None})
