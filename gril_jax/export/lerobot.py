"""Segments as subtask annotations of a LeRobot dataset: a copy with `subtask_index` on each frame.

    meta/subtasks.parquet    the names of the subtasks, as lerobot 0.4 reads them
    meta/info.json           with the feature subtask_index
    data/.../*.parquet       with the column subtask_index
    meta/episodes            of version 3.0: with the annotations of `gril_jax.export.sarm`

Videos are hard links to those of the dataset, where the file system can. The dataset stays as it
was.
"""

import importlib
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.demos.formats.lerobot import (
    Dataset,
    data_files,
    episode_files,
    parquet,
    table_of,
    title_of,
)
from gril_jax.errors import DemoError
from gril_jax.safe_files import write_whole, writing

from . import sarm

_UNKNOWN = "not segmented"  # an episode that was not among the videos


def annotate(
    dataset: Dataset, out: Path, ends: Mapping[str, Sequence[float]], names: Sequence[str]
) -> None:
    """Writes the copy into a new folder.

    Args:
      ends: seconds at which the stages of each episode's video end, increasing.
      names: of the stages.

    Raises:
      DemoError: no video is of an episode of the dataset.
    """
    files, arrow = data_files(dataset), importlib.import_module("pyarrow") if parquet() else None
    known = set()
    for file in files:
        known |= {*table_of(file, "episode_index", "frame_index")["episode_index"].to_pylist()}
    ends = {title: ends[title] for title in map(title_of, sorted(known)) if title in ends}
    if not ends:
        raise DemoError(f"{dataset.folder}: none of its episodes is among the run's videos.")
    with writing(out):
        shutil.copytree(dataset.folder, out, copy_function=_linked)
        for file in files:
            table = table_of(file)
            index = _indices(table, dataset.fps, ends, len(names))
            column = arrow.array(index, arrow.int64())
            if "subtask_index" in table.column_names:
                table = table.drop_columns(["subtask_index"])
            table = _described(table.append_column("subtask_index", column))
            _replace(table, out / file.relative_to(dataset.folder))
        _replace(_labels(arrow, [*names, _UNKNOWN]), out / "meta" / "subtasks.parquet")
        features = dict(dataset.info["features"])
        features["subtask_index"] = {"dtype": "int64", "shape": [1], "names": None}
        info = dict(dataset.info) | {"features": features}
        (out / "meta" / "info.json").unlink()
        write_whole(out / "meta" / "info.json", json.dumps(info, indent=4) + "\n")
        if dataset.packed:
            _annotate_episodes(dataset, out, ends, names)


def _annotate_episodes(
    dataset: Dataset, out: Path, ends: Mapping[str, Sequence[float]], names: Sequence[str]
) -> None:
    """Writes what SARM reads, which lerobot does not know before version 3.0."""
    for file in episode_files(dataset):
        rows = table_of(file, "episode_index", "length")
        table = sarm.described(rows, dataset.fps, ends, names)
        _replace(table, out / file.relative_to(dataset.folder))
    shares = json.dumps(sarm.proportions(ends, names), indent=2)
    write_whole(out / "meta" / "temporal_proportions_dense.json", shares + "\n")


def _described(table: Any) -> Any:
    """The table with the column among the features that Hugging Face's `datasets` notes in it."""
    known = dict(table.schema.metadata or {})
    if b"huggingface" not in known:
        return table
    try:
        about = json.loads(known.pop(b"huggingface"))
        about["info"]["features"]["subtask_index"] = {"dtype": "int64", "_type": "Value"}
    except (ValueError, LookupError, TypeError):
        return table.replace_schema_metadata(known)  # it says nothing that `datasets` could read
    return table.replace_schema_metadata(known | {b"huggingface": json.dumps(about).encode()})


def _indices(table: Any, fps: float, ends: Mapping[str, Sequence[float]], count: int) -> np.ndarray:
    """The stage of each row, from 0; `count` where the episode was not among the videos.

    Rows are frames of the video, at a constant rate; their `timestamp` may be a robot's clock."""
    episode = np.array(table["episode_index"].to_pylist())
    time = np.array(table["frame_index"].to_pylist(), float).reshape(-1) / fps
    index = np.full(len(episode), count)
    for number in np.unique(episode):
        if (title := title_of(int(number))) in ends:
            own = episode == number
            stage = np.searchsorted(np.asarray(ends[title]), time[own] - 1e-6)
            index[own] = np.minimum(stage, count - 1)  # what follows the last end is still its
    return index


def _labels(arrow: Any, names: Sequence[str]) -> Any:
    """The table of the names, which pandas reads with the names as its index."""
    table = arrow.table({"subtask_index": [*range(len(names))], "subtask": [*names]})
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy,
         "metadata": None}
        for name, kind, numpy in (("subtask_index", "int64", "int64"),
                                  ("subtask", "unicode", "object"))
    ]  # fmt: skip
    about = {"index_columns": ["subtask"], "column_indexes": [], "columns": columns,
             "creator": {"library": "pyarrow", "version": arrow.__version__}}  # fmt: skip
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _replace(table: Any, file: Path) -> None:
    """Writes a table in place of a file, which may be a link to the dataset's own."""
    file.unlink(missing_ok=True)
    parquet().write_table(table, file)


def _linked(source: str, to: str) -> None:
    """A hard link to a file, not to a link that leads to it and would lead elsewhere from here."""
    try:
        os.link(os.path.realpath(source), to)
    except OSError:
        shutil.copy2(source, to)
