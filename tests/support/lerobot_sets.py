"""Small LeRobot datasets of kitchen videos; they need pyarrow."""

import importlib
import json

import numpy as np

from gril_jax.demos.formats import lerobot
from gril_jax.demos.vision.video import write_video

from . import kitchen_films

CAMERA = "observation.images.front"
SMALL = {"fps": 10.0, "width": 64, "height": 48, "tempo": 3.0}
STORIES = [kitchen_films.story(number, **SMALL) for number in range(2)]


def write(path, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    noted = {"info": {"features": {key: {} for key in rows[0]}}}  # as `datasets` does
    arrow = importlib.import_module("pyarrow")
    table = arrow.Table.from_pylist(rows).replace_schema_metadata(
        {"huggingface": json.dumps(noted)}
    )
    lerobot.parquet().write_table(table, path)


def frames_of(number, told):
    for t, boxes in enumerate(told.boxes):
        seen = [[float("nan")] * 4 if (t + which) % 9 == 0 else boxes[which] for which in range(4)]
        yield {
            "episode_index": number, "frame_index": t, "timestamp": t / 10,
            "task_index": 0, "observation.boxes": [[float(x) for x in edges] for edges in seen],
        }  # fmt: skip


def shade(told, number):
    """Pictures that say which video and which frame they are of."""
    return [
        np.full((48, 64, 3), 40 + 100 * number + t % 50, np.uint8) for t in range(len(told.boxes))
    ]


def dataset(folder, *, feature=True):
    lengths = [len(told.boxes) for told in STORIES]
    info = {"codebase_version": "v3.0", "fps": 10, "features": {
        CAMERA: {"dtype": "video", "shape": [48, 64, 3]},
    }}  # fmt: skip
    if feature:
        about = {"dtype": "float32", "shape": [4, 4], "names": [*kitchen_films.CLASSES]}
        info["features"]["observation.boxes"] = about
    info["video_path"] = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    film = folder / "videos" / CAMERA / "chunk-000" / "file-000.mp4"
    film.parent.mkdir(parents=True)
    write_video(film, [x for n, told in enumerate(STORIES) for x in shade(told, n)], 10.0)
    begins, of = [0.0, lengths[0] / 10], f"videos/{CAMERA}/"
    write(folder / "meta/episodes/chunk-000/file-000.parquet", [
        {"episode_index": n, "length": lengths[n], f"{of}chunk_index": 0, f"{of}file_index": 0,
         f"{of}from_timestamp": begins[n], f"{of}to_timestamp": begins[n] + lengths[n] / 10}
        for n in range(2)
    ])  # fmt: skip
    rows = [row for number, told in enumerate(STORIES) for row in frames_of(number, told)]
    write(folder / "data/chunk-000/file-000.parquet", rows)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return lerobot.opened(folder)


def indexed(folder):
    """A dataset whose rows have the index that LeRobot gives them, but not in that order."""
    made = dataset(folder)
    rows = [row for number, told in enumerate(STORIES) for row in frames_of(number, told)]
    numbered = [row | {"index": i} for i, row in enumerate(rows)]
    write(folder / "data/chunk-000/file-000.parquet", numbered[::-1])
    return made, rows
