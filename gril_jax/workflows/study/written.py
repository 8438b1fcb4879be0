"""Lines of a study as CSV and as Markdown, both from lists of columns.

A line maps columns to values: `row` and `seed` say whose it is, the others are numbers, or words
that all lines of a row have; what is not known is missing, None or NaN. Shapes use K for the known
values of a row's lines.
"""

import csv as csv_format
import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax.metrics.order import interquartile_interval, interquartile_mean

Line = Mapping[str, Any]

_MOST = 4  # columns beside the rows' names


def mean_range(values: Float[np.ndarray, "K"], count: int) -> str:
    """`0.50 (0.40 to 0.60)`: the mean, the lowest and the highest of what is defined."""
    lacking = f"; {count - len(values)} undefined" if len(values) < count else ""
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f}{lacking})"


def mean_interval(*, digits: int = 3, unit: float = 1.0, middle: bool = True) -> Callable:
    """Writes mean, interquartile mean and its 95 % bootstrap interval: `84.4; 85.0 (71.9 to 96.9)`.

    A value of 1 is written as `unit`; without `middle` the interval stands alone.
    """

    def written(values: Float[np.ndarray, "K"], count: int) -> str:
        mean = f"{unit * values.mean():.{digits}f}"
        if len(values) == 1 and not middle:
            return mean
        found = _interquartile(jnp.asarray(unit * values, jnp.float32))
        between, low, high = (f"{float(x):.{digits}f}" for x in found)
        return f"{mean}; {between} ({low} to {high})" if middle else f"{mean} ({low} to {high})"

    return written


@jax.jit
def _interquartile(values):
    low, high = interquartile_interval(jax.random.key(0), values)
    return interquartile_mean(values), low, high


def median_reached(*, unit: float, digits: int) -> Callable:
    """Writes the median of steps or seconds, and how many of the seeds got there: `4.8 (4 of 5)`.

    Seeds that never got there come last; of an even number the later of the middle two counts.
    """

    def written(values: Float[np.ndarray, "K"], count: int) -> str:
        late = count // 2
        shown = f"{unit * np.sort(values)[late]:.{digits}f}" if late < len(values) else "never"
        return f"{shown} ({len(values)} of {count})"

    return written


class Column(NamedTuple):
    """One column of a section."""

    name: str  # in the lines
    heading: str
    write: Callable[[Any, int], str] = mean_range  # of a row's known values, and its lines' number
    among: str = ""  # written for the lines that have a number of this name, known or not


class Section(NamedTuple):
    """Columns that stand together below a caption."""

    caption: str
    columns: Sequence[Column]


SEEDS = Column("seed", "seeds", lambda values, count: str(count))


def column(lines: Sequence[Line], name: str) -> Float[np.ndarray, "n"]:
    """One number of each line; NaN where it is missing."""
    values = (line.get(name) for line in lines)
    return np.array([np.nan if x is None else x for x in values], np.float64)


def by_row(lines: Sequence[Line], name: str) -> dict[str, Float[np.ndarray, "n"]]:
    """Row to one number of each of its lines."""
    return {row: column(members, name) for row, members in _rows(lines).items()}


def with_published(
    lines: Sequence[Line], published: Mapping[str, Mapping[str, float]]
) -> list[Line]:
    """The lines with published numbers of their row, of a column NAME as `published NAME`."""
    return [
        dict(line)
        | {
            f"published {x}": str(of[line["row"]])
            for x, of in published.items()
            if line["row"] in of
        }
        for line in lines
    ]


def cells(lines: Sequence[Line], columns: Sequence[Column]) -> dict[str, list[str]]:
    """Row to what stands in each column; empty where nothing is known."""
    rows = _rows(lines).items()
    return {row: [_cell(members, one) for one in columns] for row, members in rows}


def _rows(lines: Sequence[Line]) -> dict[str, list[Line]]:
    of: dict[str, list[Line]] = {}
    for line in lines:
        of.setdefault(line["row"], []).append(line)
    return of


def _cell(lines: Sequence[Line], one: Column) -> str:
    said = [line[one.name] for line in lines if isinstance(line.get(one.name), str)]
    if said:  # words, the same in all lines of a row
        return said[0]
    lines = [line for line in lines if not one.among or line.get(one.among) is not None]
    values = column(lines, one.name)
    known = values[np.isfinite(values)]
    return one.write(known, len(lines)) if len(known) or (one.among and lines) else ""


def markdown(lines: Sequence[Line], sections: Sequence[Section]) -> str:
    """Sections as tables of at most five columns; a column or row without numbers is left out."""
    parts = []
    for caption, columns in sections:
        known = [
            one for one in columns if any(x.get(one.among or one.name) is not None for x in lines)
        ]
        if not known:
            continue
        parts.append(caption)
        for start in range(0, len(known), _MOST):
            part = known[start : start + _MOST]
            table = ["| | " + " | ".join(one.heading for one in part) + " |"]
            table.append("|---" * (len(part) + 1) + "|")
            table += [
                f"| {row} | " + " | ".join(texts) + " |"
                for row, texts in cells(lines, part).items()
                if any(texts)
            ]
            parts.append("\n".join(table))
    return "\n\n".join(parts)


def csv(lines: Sequence[Line], columns: Sequence[str]) -> str:
    """One line for each, in these columns; what is not known or not finite is empty."""
    file = io.StringIO()
    writer = csv_format.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for line in lines:
        writer.writerow([_in_csv(line.get(name)) for name in columns])
    return file.getvalue()


def _in_csv(value: Any) -> Any:
    if isinstance(value, str | int):
        return value
    return f"{value:.6g}" if value is not None and np.isfinite(value) else ""
