"""One family of tables as a value, and the results that it is written from."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.experiments.pipeline.demonstrations import Demonstrations

from gril_jax.config import RunConfig

from .curves import Curve, at_the_end
from .measures import Measure
from .programs import Program
from .rows import Row, Settings, changed, write_settings
from .written import Line


class Found(NamedTuple):
    """The results of the rows and seeds that have finished, in the order of the table."""

    names: list[str]  # of all rows
    lines: list[Line]
    curves: list[Curve]  # of the policies
    profiles: Mapping[str, Mapping[str, Any]]  # of a row's rewards along demonstrations
    about: Mapping[str, Any]  # command, versions, device, date, and the demonstrations' digest


def _configs(config: RunConfig, settings: Settings) -> list[RunConfig]:
    return [changed(config, change) for change in settings.rows.values()]


class Table(NamedTuple):
    """One family of tables: its rows are in its settings, the rest is here."""

    name: str  # of its verb and of its files
    columns: Callable[[Sequence[Line]], Sequence[str]]  # of the CSV
    text: Callable[[Found], str]  # in Markdown
    pictures: Callable[[Found, bool], Mapping[str, bytes]]  # by file name; True at the end
    settings: type[Settings] = Settings
    configs: Callable[[RunConfig, Any], Sequence[RunConfig]] = _configs  # one a row
    plan: Callable[[list[Row], int, Any], list[Program]] = lambda rows, num_classes, settings: []
    policy: Callable[[Curve], Mapping[str, Any]] = at_the_end  # its numbers in the lines
    measured: Mapping[str, Sequence[str]] = {}  # measure to its numbers in the lines
    measures: Callable[[RunConfig, Any, Demonstrations], list[Measure]] = lambda *_: []
    reference: Callable[[Demonstrations], list[Line]] = lambda demos: []  # lines of no row
    save: Callable[[Path, str, Any], None] = write_settings
    names: Callable[[Any], Sequence[str]] = lambda settings: [*settings.rows]
    complete: Callable[[Found, Any], Found] = lambda found, settings: found  # as read from a run
    joins_csv: bool = False  # tables of joined runs are made of their CSV alone
    order: Sequence[str] = ()  # of rows of joined runs; as they are given where empty
    summary: Callable[[Found], Mapping[str, Any]] = lambda found: {}  # in results.json
    one_set: bool = True  # of demonstrations for all rows
