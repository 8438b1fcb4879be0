"""COCO JSON of videos: `videos`, `images`, `annotations` with `track_id`, `categories`.

A frame's number is its `frame_id` or `frame_index`, from 0 or 1, else its place among the images of
its video in order of the numbers of their file names. `bbox` is left, top, width, height in pixels.
A video's images are those of its name in `videos`; without these, those of its folder.
"""

from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.errors import DemoError

from .clock import first_of, natural, number_in, require_whole, series_of
from .names import best, composed
from .record import Box, Film, box, checked, field, load, number, whole


class _Image(NamedTuple):
    """One image of a file."""

    ident: int
    given: Any  # its frame_id or frame_index, if it has one
    name: str
    where: str


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    tree = load(path)
    if isinstance(tree, dict) and not {*tree} & {"categories", "images"}:
        raise DemoError(
            f"{path}: the field 'categories' is missing, as are images, so this JSON is not of "
            "COCO or Label Studio; export one of these."
        )
    names = {}
    for n, one in enumerate(field(tree, "categories", list, str(path))):
        where = f"{path}, category {n}"
        ident, name = field(one, "id", int, where), field(one, "name", str, where)
        if names.setdefault(ident, name) != name:
            raise DemoError(
                f"{where}: id {ident} is {names[ident]!r:.60} before, and {name!r:.60}."
            )
    video = _video(field(tree, "videos", list, str(path), []), path, film)
    images = field(tree, "images", list, str(path))
    own = _images(images, video, path, film)
    known = {image.ident for image in own}
    every = {one["id"] for one in images}
    found = []
    for n, one in enumerate(field(tree, "annotations", list, str(path))):
        where = f"{path}, annotation {n}"
        category = field(one, "category_id", int, where)
        if category not in names:
            raise DemoError(f"{where}: category_id {category} is not among the categories.")
        image = field(one, "image_id", int, where)
        if image not in every:
            raise DemoError(f"{where}: image_id {image} is not among the images.")
        if image in known:
            found.append((image, names[category], _edges(one, where), where, one))
    if not found:
        return checked([], path, film)
    # Tools that count from 0 do so in each video.
    zero = any(_number(one) == 0 for one in images)
    frames, first = _frames(own, zero, path, film)
    boxes = [
        box(film, frames[image], name, edges, where, confidence=one.get("score", 1.0),
            track=_track(one), first=first)
        for image, name, edges, where, one in found
    ]  # fmt: skip
    # A frame without boxes was looked at, too.
    require_whole(path, film, frames.values(), "list an image of the last frame")
    return checked(boxes, path, film)


def _number(image: dict[str, Any]) -> Any:
    """The number of an image's frame, under the name that its tool gives it."""
    found = (image.get(name) for name in ("frame_id", "frame_index", "frame_number"))
    return next((number for number in found if number is not None), None)


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
    ids, named = [], []
    for n, one in enumerate(videos):
        where = f"{path}, video {n}"
        name = one.get("name") or one.get("file_name") if isinstance(one, dict) else None
        if not isinstance(name, str):
            raise DemoError(f"{where}: a video needs a name.")
        ids.append(field(one, "id", int, where)), named.append([name])
    return ids[_one_of(best(film.path, named), [name for (name,) in named], path, film)]


def _one_of(found: list[int], names: list[str], path: Path, film: Film) -> int:
    if not found:
        raise DemoError(
            f"{path}: no video is called {film.path.stem!r}; there are {', '.join(names)[:200]}."
        )
    if len(found) > 1:
        raise DemoError(
            f"{path}: {len(found)} videos are called like {film.path.name}, such as "
            f"{names[found[0]]!r:.60}; names must differ."
        )
    return found[0]


def _images(images: list[Any], video: int | None, path: Path, film: Film) -> list[_Image]:
    """The images of the video."""
    own = []
    for n, one in enumerate(images):
        where = f"{path}, image {n}"
        ident = field(one, "id", int, where)
        if video is None or one.get("video_id") == video:
            given = _number(one)
            own.append((_Image(ident, given, str(one.get("file_name", "")), where), one))
    own = own if video is not None else _of_folder(own, path, film)
    for image, one in own:
        for side, pixels in (("width", film.width), ("height", film.height)):
            if (one.get(side) or pixels) != pixels:
                raise DemoError(
                    f"{image.where}: the {side} is {one[side]!r:.60}, but {film.path.name} is "
                    f"{film.width} x {film.height} pixels."
                )
    return [image for image, _ in own]


def _of_folder(own: list, path: Path, film: Film) -> list:
    """The images of the video's folder, or whose names begin with its; all, if they are alike."""
    series: dict[str, list] = {}
    for pair in own:
        series.setdefault(series_of(pair[0].name), []).append(pair)
    if len(series) < 2:
        return own
    parts = [[*name.split("/")[:-1], name.rsplit("/", 1)[-1].rstrip("_-. ")] for name in series]
    short, whole_name = composed(film.path.stem), composed(film.path.name.replace(".", "_"))
    if several := [n for n, each in enumerate(parts)
                   if {short, film.path.name, whole_name} & {*map(composed, each)}]:  # fmt: skip
        names = [*series]
        return [pair for n in several for pair in series[names[n]]]
    unnumbered = all(number_in(image.name) is None for image, _ in own)
    if unnumbered or len(own) == len(film.times) or len(series) == len(own):
        return own
    listed = ", ".join(name or "images without a folder" for name in series)[:200]
    raise DemoError(
        f"{path}: the images are of several videos ({listed}), and none is called "
        f"{film.path.stem!r}; their folders must have the names of the videos."
    )


def _frames(own: list[_Image], zero: bool, path: Path, film: Film) -> tuple[dict[int, int], int]:
    """The frame of each image of the video, by the image's id, and the first frame's number."""
    given = [image for image in own if image.given is not None]
    if given and len(given) < len(own):
        lacks = next(image for image in own if image.given is None)
        raise DemoError(f"{lacks.where}: it has no frame_id, but other images have one.")
    if given:
        numbers = [whole(image.given, "frame_id", image.where, least=0) for image in own]
        first = 0 if zero else first_of(numbers, film, "frame_id", str(path))
    else:
        numbers, first = _by_name(own, path, film)
    frames: dict[int, int] = {}
    for image, at in zip(own, numbers, strict=True):
        if at in frames:
            raise DemoError(
                f"{image.where}: an image of frame {at} is there before; if the file is of "
                "several videos, `videos` must name them."
            )
        frames[at] = image.ident
    return {ident: at - first for at, ident in frames.items()}, first


def _by_name(own: list[_Image], path: Path, film: Film) -> tuple[list[int], int]:
    """The numbers of images without frame_id, and that of the first frame."""
    total, numbers = len(film.times), [number_in(image.name) for image in own]
    if len(own) == total:  # all frames, in order of their numbers: 1, 2, 10
        order = sorted(own, key=lambda image: (natural(image.name), image.ident))
        places = {id(image): place for place, image in enumerate(order)}
        return [places[id(image)] for image in own], 0
    if None in numbers or len(own) > total or len({*numbers}) < len(own):
        raise DemoError(
            f"{path}: {len(own)} images without frame_id are of {film.path.name}, which has "
            f"{total} frames: give each image the frame_id of its frame."
        )
    return numbers, first_of(numbers, film, "the number of an image", str(path), usual=1)


def _edges(annotation: Any, where: str) -> tuple[float, float, float, float]:
    if not annotation.get("bbox") and annotation.get("segmentation"):
        raise DemoError(
            f"{where}: a mask or polygon is in a box's place; export boxes, so that it has a bbox."
        )
    values = field(annotation, "bbox", list, where)
    if len(values) != 4:
        raise DemoError(f"{where}: bbox must be left, top, width and height, not {values!r:.60}.")
    left, top, width, height = (number(value, "bbox", where) for value in values)
    return left, top, left + width, top + height
