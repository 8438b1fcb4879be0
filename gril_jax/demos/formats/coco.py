"""COCO JSON of videos: `videos`, `images`, `annotations` with `track_id`, `categories`.

A frame's number is its `frame_id` or `frame_index`, from 0, else its place among the images of its
video in order of their file names. `bbox` is left, top, width, height in pixels. Where there are
several videos, a video's is the one of its name.
"""

from pathlib import Path
from typing import Any

from gril_jax.errors import DemoError

from .record import Box, Film, box, checked, field, load, number, stem, whole


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    tree = load(path)
    names = {}
    for n, one in enumerate(field(tree, "categories", list, str(path))):
        where = f"{path}, category {n}"
        names[field(one, "id", int, where)] = field(one, "name", str, where)
    video = _video(field(tree, "videos", list, str(path), []), path, film)
    images = field(tree, "images", list, str(path))
    frames = _frames(images, video, path, film)
    found: list[Box] = []
    for n, one in enumerate(field(tree, "annotations", list, str(path))):
        where = f"{path}, annotation {n}"
        category = field(one, "category_id", int, where)
        if category not in names:
            raise DemoError(f"{where}: category_id {category} is not among the categories.")
        image = field(one, "image_id", int, where)
        if image not in frames:
            if any(isinstance(x, dict) and x.get("id") == image for x in images):
                continue  # of another video
            raise DemoError(f"{where}: image_id {image} is not among the images.")
        edges = _edges(field(one, "bbox", list, where), where)
        about = {"confidence": one.get("score", 1.0), "track": _track(one)}
        found.append(box(film, frames[image], names[category], edges, where, **about))
    return checked(found, path, film)


def _track(annotation: dict[str, Any]) -> Any:
    """An object's identity: of its own, or among the attributes, as CVAT and datumaro write it."""
    more = annotation.get("attributes")
    places = [annotation, more] if isinstance(more, dict) else [annotation]
    found = (one.get(name) for one in places for name in ("track_id", "instance_id"))
    return next((track for track in found if track is not None), None)


def _video(videos: list[Any], path: Path, film: Film) -> int | None:
    """The id of the video's video; None where the file is of one video."""
    if len(videos) < 2:
        return None
    ids = {}
    for n, one in enumerate(videos):
        where = f"{path}, video {n}"
        name = one.get("name") or one.get("file_name") if isinstance(one, dict) else None
        if not isinstance(name, str):
            raise DemoError(f"{where}: a video needs a name.")
        ids[stem(name)] = field(one, "id", int, where)
    if film.path.stem not in ids:
        raise DemoError(
            f"{path}: no video is called {film.path.stem!r}; there are {', '.join(ids)[:200]}."
        )
    return ids[film.path.stem]


def _frames(images: list[Any], video: int | None, path: Path, film: Film) -> dict[int, int]:
    """The frame of each image of the video, by the image's id."""
    own = []
    for n, one in enumerate(images):
        where = f"{path}, image {n}"
        ident = field(one, "id", int, where)
        if video is not None and one.get("video_id") != video:
            continue
        for side, pixels in (("width", film.width), ("height", film.height)):
            if one.get(side, pixels) != pixels:
                raise DemoError(
                    f"{where}: the {side} is {one[side]!r:.60}, but {film.path.name} is "
                    f"{film.width} x {film.height} pixels."
                )
        given = one.get("frame_id", one.get("frame_index"))
        own.append((ident, given, str(one.get("file_name", "")), where))
    if all(given is not None for _, given, _, _ in own):
        return {ident: whole(given, "frame_id", where, least=0) for ident, given, _, where in own}
    ordered = sorted(own, key=lambda image: (image[2], image[0]))
    return {image[0]: frame for frame, image in enumerate(ordered)}


def _edges(values: list[Any], where: str) -> tuple[float, float, float, float]:
    if len(values) != 4:
        raise DemoError(f"{where}: bbox must be left, top, width and height, not {values!r:.60}.")
    left, top, width, height = (number(value, "bbox", where) for value in values)
    return left, top, left + width, top + height
