"""Segments as the dense subtask annotations that SARM (arXiv 2509.25358) learns from in lerobot.

    dense_subtask_names           a list for each row of meta/episodes, null if not segmented
    dense_subtask_start_times     seconds from the episode's first frame, and so `..._end_times`
    dense_subtask_start_frames    frames of the episode, and so `..._end_frames`

`meta/temporal_proportions_dense.json` has the mean share of an episode that each subtask takes.
lerobot reads both with `annotation_mode="dense_only"`, from datasets of version 3.0.
"""

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gril_jax.demos.formats.lerobot import title_of

_SLACK = 1e-6  # seconds by which a frame may be after the end of its stage


def described(
    episodes: Any, fps: float, ends: Mapping[str, Sequence[float]], names: Sequence[str]
) -> Any:
    """The table of episodes with the five columns.

    Args:
      episodes: a row an episode, with `episode_index` and `length`.
      fps: frames a second of the dataset.
      ends: seconds at which the stages of each episode's video end, increasing.
      names: of the stages.
    """
    arrow = importlib.import_module("pyarrow")
    found = [
        of_episode(ends[title], fps, row["length"], names)
        if (title := title_of(row["episode_index"])) in ends
        else {}
        for row in episodes.select(["episode_index", "length"]).to_pylist()
    ]
    kinds = dict.fromkeys(("start_times", "end_times"), arrow.float64())
    kinds |= dict.fromkeys(("start_frames", "end_frames"), arrow.int64())
    for key, kind in {"names": arrow.string(), **kinds}.items():
        column = f"dense_subtask_{key}"
        if column in episodes.column_names:
            episodes = episodes.drop_columns([column])
        values = arrow.array([one.get(key) for one in found], arrow.list_(kind))
        episodes = episodes.append_column(column, values)
    known = dict(episodes.schema.metadata or {})
    known.pop(b"huggingface", None)  # the columns that there were
    return episodes.replace_schema_metadata(known)


def of_episode(
    ends: Sequence[float], fps: float, length: int, names: Sequence[str]
) -> dict[str, list[Any]]:
    """The annotations of one episode of `length` frames; a subtask begins where the last one ends.

    >>> of_episode([0.5, 1.0], 10.0, 15, ["reach", "lift"])["start_frames"]
    [0, 5]
    """
    last = np.minimum(np.floor((np.asarray(ends) + _SLACK) * fps), length - 1).astype(int).tolist()
    return {
        "names": [*names],
        "start_times": [0.0, *ends[:-1]], "end_times": [*ends],
        "start_frames": [0, *last[:-1]], "end_frames": last,
    }  # fmt: skip


def proportions(ends: Mapping[str, Sequence[float]], names: Sequence[str]) -> dict[str, float]:
    """The mean share of its video that each stage takes, up to the last end.

    >>> proportions({"a": [1.0, 4.0], "b": [3.0, 4.0]}, ["reach", "lift"])
    {'reach': 0.5, 'lift': 0.5}
    """
    shares = [np.diff([0.0, *one]) / one[-1] for one in ends.values()]
    return dict(zip(names, np.mean(shares, axis=0).tolist(), strict=True))
