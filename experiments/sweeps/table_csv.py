"""Lines of a table as CSV, and back: a row's name, a seed, then numbers."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["read", "written"]


def written(lines: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """One line for each; what is not known (missing or None) or not finite is empty.

    Args:
      lines: with "row", "seed" and numbers by their columns.
      columns: "row" and "seed" first.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for line in lines:
        numbers = (line.get(name) for name in columns[2:])
        cells = (f"{x:.6g}" if x is not None and np.isfinite(x) else "" for x in numbers)
        writer.writerow([line["row"], line["seed"], *cells])
    return file.getvalue()


def read(text: str, columns: Sequence[str]) -> list[dict[str, Any]]:
    """The lines of `written`.

    Raises:
      KeyError, TypeError, ValueError: a column is missing or holds no number.
    """
    return [
        {"row": line["row"], "seed": int(line["seed"])}
        | {name: float(line[name]) for name in columns[2:] if line[name]}
        for line in csv.DictReader(io.StringIO(text))
    ]
