"""Arrays of a run that are no state: NumPy's own files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def save_arrays(file: Path, arrays: Mapping[str, Any]) -> None:
    """Writes the arrays by their names to a .npz file, as `numpy.load` reads it."""
    np.savez(file, **arrays)
