"""A learned reward as the progress of each frame of a LeRobot dataset, for reward-weighted cloning.

    index, episode_index, frame_index    int64: the frame in the dataset, and in its episode
    progress_sparse                      float32 from 0 to 1; NaN where it is not known

These are the columns of `sarm_progress.parquet` that lerobot's `RABCWeights` reads (RA-BC, SARM,
arXiv 2509.25358): a sample weighs more, the more progress it is followed by.
"""

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gril_jax.demos.formats.lerobot import Dataset, data_files, parquet, table_of, title_of
from gril_jax.errors import DemoError

_COLUMNS = ("index", "episode_index", "frame_index")


class Trace(NamedTuple):
    """Rewards along one video."""

    reward: Float[np.ndarray, "T"]  # about -1 at the start and 0 at the goal
    time: Float[np.ndarray, "T"]  # seconds from the first frame of the video, increasing


def progress(trace: Trace, time: Float[np.ndarray, "F"]) -> Float[np.ndarray, "F"]:
    """The reward plus 1, at some times, within 0 and 1.

    It is interpolated between frames; beyond a trace it is that of the nearest end.

    >>> trace = Trace(np.array([-1.2, -0.5, 0.0]), np.array([0.0, 1.0, 2.0]))
    >>> progress(trace, np.array([0.0, 1.5, 9.0])).tolist()
    [0.0, 0.75, 1.0]
    """
    return np.clip(1 + np.interp(time, trace.time, trace.reward), 0.0, 1.0)


def write_progress(
    dataset: Dataset, out: Path, traces: Mapping[str, Trace], *, source: str
) -> tuple[int, int]:
    """Writes the table of all frames, in the order of the dataset.

    Args:
      out: file to write.
      traces: by the name of an episode's video. Frames of other episodes have NaN.
      source: what made the rewards, noted in the file as the path of the reward model.

    Returns:
      How many frames have a progress, and how many there are.

    Raises:
      DemoError: no video is of an episode of the dataset.
    """
    module = parquet()  # a sentence if it is not installed
    arrow = importlib.import_module("pyarrow")
    parts = [table_of(file, *_COLUMNS) for file in data_files(dataset)]
    table = {
        name: np.concatenate([np.array(part[name].to_pylist(), np.int64).ravel() for part in parts])
        for name in _COLUMNS
    }
    order = np.argsort(table["index"], kind="stable")
    table = {name: values[order] for name, values in table.items()}
    found = np.full(len(order), np.nan, np.float32)
    for number in np.unique(table["episode_index"]):
        if trace := traces.get(title_of(int(number))):
            own = table["episode_index"] == number
            found[own] = progress(trace, table["frame_index"][own] / dataset.fps)
    known = int(np.isfinite(found).sum())
    if not known:
        raise DemoError(f"{dataset.folder}: none of its episodes is among the run's videos.")
    whole = arrow.table({**table, "progress_sparse": found})
    part = out.with_name(f".{out.name}.part")
    module.write_table(whole.replace_schema_metadata({"reward_model_path": source}), part)
    os.replace(part, out)
    return known, len(order)
