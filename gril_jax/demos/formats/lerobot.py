"""LeRobot datasets, v3.0 and v2.1: the videos of one camera, and boxes that come with them.

    meta/info.json     version, fps, features, and where data and videos are
    meta/episodes      a row an episode: v3.0 in parquet files, v2.1 in episodes.jsonl

Boxes are those of a feature of shape (N, 4) whose name ends in "boxes" and whose `names` are N
classes: x_min, y_min, x_max, y_max in pixels, NaN where an object is not seen. Else they are files
`boxes/episode_000000.*` in the dataset, in any format of boxes beside videos. Parquet is read
by pyarrow, an optional extra. Paths that a dataset names stay within its folder; links in it are
the user's own, as in the cache of Hugging Face, and may lead anywhere.
"""

import importlib
import json
import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from gril_jax.demos.folders import visible
from gril_jax.demos.formats import file_of, reader
from gril_jax.demos.formats.record import Box, Film, box, checked, field, load, read_text, whole
from gril_jax.demos.vision.timed import look, part
from gril_jax.errors import ConfigError, DemoError

_VERSIONS = ("v3.0", "v2.1")
_WHERE = ("chunk_index", "file_index", "from_timestamp", "to_timestamp")
_BOXES = "boxes"  # how a feature's name ends, and the folder of files
_SLACK = 0.01  # share of an episode's rows by which its video may be longer or shorter
_OFF = 0.02  # share by which the rates of the videos and of the dataset may differ
_POINTER = b"version https://git-lfs.github.com/"


class Dataset(NamedTuple):
    """A dataset's folder and what its meta/info.json says."""

    folder: Path
    info: Mapping[str, Any]

    @property
    def where(self) -> str:
        """The file that says it."""
        return str(self.folder / "meta" / "info.json")

    @property
    def packed(self) -> bool:
        """True if a file holds several episodes: v3.0."""
        return self.info["codebase_version"] == "v3.0"

    @property
    def fps(self) -> float:
        """Frames a second."""
        return float(self.info["fps"])


def is_dataset(folder: Path) -> bool:
    """True for the folder of a LeRobot dataset."""
    return (folder / "meta" / "info.json").is_file()


def opened(folder: Path) -> Dataset:
    """A dataset; a DemoError if it is of a version that is not known."""
    where = str(folder / "meta" / "info.json")
    if read_text(folder / "meta" / "info.json").startswith("../"):
        raise DemoError(
            f"{where}: not JSON but the text of a link; copy the dataset with the files that its "
            "links lead to."
        )
    info = load(folder / "meta" / "info.json")
    version = field(info, "codebase_version", str, where)
    if version not in _VERSIONS:
        raise DemoError(
            f"{where}: codebase_version is {version!r:.20}, but must be {' or '.join(_VERSIONS)}; "
            "lerobot's own scripts convert datasets of other versions."
        )
    if not 0.1 <= (fps := field(info, "fps", int | float, where)) <= 1000:
        raise DemoError(f"{where}: fps is {fps}, but must be from 0.1 to 1000.")
    for name, about in field(info, "features", dict, where).items():
        field({name: about}, name, dict, f"{where}, features")
    return Dataset(folder, info)


def episodes(dataset: Dataset) -> list[dict[str, Any]]:
    """A row an episode, in order."""
    if dataset.packed:
        files = episode_files(dataset)
        rows = [row for file in files for row in table_of(file, "episode_index").to_pylist()]
    else:
        rows = _lines(dataset.folder / "meta" / "episodes.jsonl")
    if not rows:
        raise DemoError(f"{dataset.folder / 'meta'}: the dataset has no episodes.")
    return sorted(rows, key=lambda row: row["episode_index"])


def _lines(file: Path) -> list[dict[str, Any]]:
    """The rows of episodes.jsonl."""
    found = []
    for number, line in enumerate(read_text(file).splitlines(), 1):
        where = f"{file}, line {number}"
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except ValueError:
            raise DemoError(f"{where}: not JSON.") from None
        if not isinstance(row, dict):
            raise DemoError(f"{where}: must be an object with an episode_index.")
        field(row, "episode_index", int, where)
        found.append(row)
    return found


def camera_of(dataset: Dataset, camera: str | None) -> str:
    """The camera of this name, or the only one; else a DemoError that lists them."""
    features = dataset.info["features"].items()
    known = [name for name, about in features if about.get("dtype") == "video"]
    if camera is None and len(known) == 1:
        return known[0]
    if not known:
        raise DemoError(
            f"{dataset.where}: no feature is a video (dtype video), but a camera's pictures must "
            "be; record or convert the dataset with videos."
        )
    if camera not in known:
        asked = "several cameras" if camera is None else f"no camera {camera!r}"
        raise DemoError(
            f"{dataset.where}: there are {asked}; name one of {', '.join(known)} with --camera."
        )
    return camera


def films(dataset: Dataset, camera: str) -> list[Film]:
    """The video of each episode."""
    found, files, of = [], {}, f"videos/{camera}/"
    for row in episodes(dataset):
        if not dataset.packed:
            number = row["episode_index"]
            values = {"video_key": camera, "episode_index": number}
            size = whole(
                dataset.info.get("chunks_size", 1000), "chunks_size", dataset.where, least=1
            )
            path = _film_file(dataset, values | {"episode_chunk": number // size})
            found.append(_require_rate(dataset, look(path))._replace(title=title_of(number)))
            continue
        if lacks := [key for key in _WHERE if not isinstance(row.get(of + key), int | float)]:
            raise DemoError(f"{dataset.folder}: its episodes lack {of}{lacks[0]}.")
        number, places = row["episode_index"], {key: row[of + key] for key in _WHERE[:2]}
        path = _film_file(dataset, places | {"video_key": camera, "episode_index": number})
        if path not in files:
            files[path] = _require_rate(dataset, look(path))
        begin, end = row[f"{of}from_timestamp"], row[f"{of}to_timestamp"]
        found.append(part(files[path], begin, end, title_of(number)))
    return found


def _require_rate(dataset: Dataset, film: Film) -> Film:
    """The video; a DemoError if its rate is not the dataset's, so that one clock is wrong."""
    if abs(film.fps / dataset.fps - 1) > _OFF:
        raise DemoError(
            f"{film.path}: has {film.fps:.4g} frames a second, but {dataset.where} says fps "
            f"{dataset.fps:g}; correct the one that is wrong."
        )
    return film


def title_of(number: int) -> str:
    """The name of an episode's video.

    >>> title_of(3)
    'episode_000003'
    """
    return f"episode_{number:06d}"


def _film_file(dataset: Dataset, values: Mapping[str, Any]) -> Path:
    """The path that the template of meta/info.json gives, which must be within the dataset."""
    name = "video_path"
    template = field(dataset.info, name, str, dataset.where)

    def filled(match: re.Match) -> str:
        key, digits = match[1], match[2]
        if key not in values:
            raise DemoError(f"{dataset.where}: {name} has {match[0]!r:.60}, which is not known.")
        return str(values[key]) if digits is None else f"{int(values[key]):0{int(digits)}d}"

    named = PurePosixPath(re.sub(r"\{(\w+)(?::0?(\d)d)?\}", filled, template))
    if named.is_absolute() or ".." in named.parts:  # of names alone: a link is the user's own
        raise DemoError(f"{dataset.where}: {name} leads out of the dataset, to {named}.")
    return dataset.folder / named


def boxes_in(dataset: Dataset):
    """(video) -> the boxes of an episode's video, of a feature or of a file."""
    features = dataset.info["features"].items()
    named = [name for name, about in features if name.endswith(_BOXES)]
    if not named:

        def beside(film: Film) -> list[Box]:
            if not (dataset.folder / _BOXES).is_dir():
                raise DemoError(
                    f"{dataset.folder}: the dataset has no boxes; there must be a feature whose "
                    f"name ends in {_BOXES!r}, or files such as {_BOXES}/{film.name}.csv."
                )
            path = file_of(dataset.folder / _BOXES / f"{film.name}.mp4")
            return reader(path)(path, film)

        return beside
    about = dataset.info["features"][named[0]]
    classes, shape = about.get("names"), about.get("shape")
    if not isinstance(classes, list) or shape != [len(classes), 4]:
        raise DemoError(
            f"{dataset.where}: {named[0]} has shape {shape!r:.60}, but must have (N, 4) and N "
            "class names."
        )
    rows = frames(dataset, named[0])

    def inside(film: Film) -> list[Box]:
        own = rows.get(int(film.name.rsplit("_", 1)[1]), [])
        _require_as_many(dataset, film, len(own))
        return _of_feature(film, own, classes, named[0])

    return inside


def _require_as_many(dataset: Dataset, film: Film, rows: int) -> None:
    """Raises DemoError if an episode's rows cannot be its frames, one a row."""
    count = len(film.times)
    if abs(rows - count) > max(1, _SLACK * count):
        raise DemoError(
            f"{film.path}: {film.name} has {count} frames at {film.fps:.3g} a second, but "
            f"{rows} rows of data at {dataset.fps:g}; there must be a row for each frame."
        )


def frames(dataset: Dataset, column: str) -> dict[int, list[Any]]:
    """A column of the data, in order of time, by episode."""
    found: dict[int, list[Any]] = {}
    for file in data_files(dataset):
        table = table_of(file, "episode_index", "frame_index", column)
        for row in sorted(table.to_pylist(), key=lambda row: row["frame_index"]):
            found.setdefault(row["episode_index"], []).append(row[column])
    return found


def episode_files(dataset: Dataset) -> list[Path]:
    """The parquet files of the rows of episodes, of version 3.0."""
    return visible(dataset.folder / "meta" / "episodes", "chunk-*/file-*.parquet")


def data_files(dataset: Dataset) -> list[Path]:
    """The parquet files of the data."""
    return visible(dataset.folder / "data", "chunk-*/*.parquet")


def _of_feature(film: Film, rows: list[Any], classes: list[str], name: str) -> list[Box]:
    found = []
    for frame, row in enumerate(rows[: len(film.times)]):
        where = f"{film.path}, {film.name}, {name}, frame {frame}"
        if row is None or len(row) != len(classes):
            raise DemoError(f"{where}: there must be {len(classes)} boxes, one a class.")
        for track, (kind, edges) in enumerate(zip(classes, row, strict=True)):
            if len(edges) != 4:
                raise DemoError(f"{where}: a box must be x_min, y_min, x_max and y_max.")
            if not np.isnan(edges).any():
                found.append(box(film, frame, kind, list(edges), where, track=track))
    return checked(found, film.path, film)


def table_of(file: Path, *columns: str) -> Any:
    """A parquet file as a table that has these columns; a DemoError if it is none."""
    try:
        table = parquet().read_table(file)
    except (OSError, ValueError) as error:
        if _is_pointer(file):
            raise DemoError(
                f"{file}: not the data but a Git LFS pointer to them; `git lfs pull` fetches them."
            ) from None
        raise DemoError(f"{file}: not a parquet file ({str(error).splitlines()[0]}).") from None
    if lacks := [name for name in columns if name not in table.column_names]:
        raise DemoError(f"{file}: the column {lacks[0]!r} is missing.")
    return table


def _is_pointer(file: Path) -> bool:
    """True for the text that Git LFS has in place of a large file."""
    try:
        with open(file, "rb") as stream:
            return stream.read(len(_POINTER)) == _POINTER
    except OSError:
        return False


def parquet() -> Any:
    """The module that reads and writes parquet; a ConfigError if it is not installed."""
    try:
        return importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise ConfigError(
            "LeRobot datasets are in parquet files, but pyarrow is not installed: "
            "pip install 'gril-jax[lerobot]'"
        ) from None
