"""The format of a reward file: arrays, description and the checks of both; and the bytes of
any exported file.

`gril_jax.export.reward_file` says what the fields of the description mean. A file is an npz file,
uncompressed, whose zip comment is the SHA-256 of all bytes before it: any flipped bit is noticed,
also where zip does not look. `unpack` of `gril_jax.export.read_policy` reads it.
"""

import hashlib
import importlib.metadata
import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import AnyConfig
from gril_jax.encoders.ensemble import latent_size, num_members
from gril_jax.errors import ConfigError, GrilError, ShapeError, is_printable
from gril_jax.graphs import activity_rule
from gril_jax.graphs.activity_rule import PAPER
from gril_jax.losses import heads
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward

FORMAT, VERSION = "gril-jax reward", 3
_LATER = ("encoder.pair_statistics",)  # files without them mean the default
_DIGITS = 64  # of the SHA-256


class RewardFileError(GrilError):
    """A reward file is missing, damaged, of another version, or would be overwritten."""


def named(params: PyTree) -> Iterator[tuple[str, Any]]:
    """Yields (name, leaf) of every array; names are paths: encoder.head.Dense_0.bias, goal, ..."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(params):
        yield jax.tree_util.keystr(path, simple=True, separator="."), leaf


def blank_head(method: str, latent: int) -> heads.Head:
    """Shapes of the parameters of a method's head; a ConfigError if there is no such method."""
    head = heads.of(method)
    return jax.eval_shape(lambda: head.init(jax.random.key(0), latent))


def blank(config: AnyConfig, head: str | None = None) -> RewardParams:
    """Shapes of a config's parameters, for a single goal; nothing is computed.

    Raises:
      ConfigError: `head` is not the name of a method that predicts progress, or the encoder is an
        ensemble, which has none.
    """
    number = jax.ShapeDtypeStruct((), jnp.float32)
    members = num_members(config)
    scale = jax.ShapeDtypeStruct((members,) if members > 1 else (), jnp.float32)
    goal = jax.ShapeDtypeStruct((latent_size(config),), jnp.float32)
    key = jax.eval_shape(lambda: jax.random.key(0))
    made = jax.eval_shape(lambda key: encoder.init(key, config), key)
    if head is None:
        return RewardParams(encoder=made, goal=goal, scale=scale, alpha=number)
    if members > 1:
        raise ConfigError(f"encoder.ensemble_size is {members}; with a head it must be 1.")
    return RewardParams(made, goal, scale, number, blank_head(head, latent_size(config)), goal)


def check_arrays(
    arrays: Mapping[str, np.ndarray], wanted: Mapping[str, jax.ShapeDtypeStruct], where: str
) -> None:
    """Raises RewardFileError, or a ShapeError, unless arrays are finite float32 of the `named`
    shapes of their encoder; `where` begins the message."""
    if lacks := [name for name in wanted if name not in arrays]:
        raise RewardFileError(
            f"{where} lacks the array {lacks[0]!r}; its encoder needs one: save the reward again."
        )
    for name, array in arrays.items():
        if name not in wanted:
            raise RewardFileError(
                f"{where} has an array {name!r}; it must hold its encoder's arrays alone."
            )
        shape = wanted[name].shape
        several = name == "goal" and "start" not in wanted
        goals = several and array.ndim == 2 and len(array) and array.shape[1:] == shape
        if array.shape != shape and not goals:
            raise ShapeError(
                f"{where}: {name} has shape {array.shape}; with its encoder it must be {shape}."
            )
        if array.dtype != np.float32:
            raise RewardFileError(f"{where}: {name} is {array.dtype}; it must be float32.")
        if not np.isfinite(array).all():
            raise RewardFileError(f"{where}: {name} is not finite; train the reward again.")
        if name in ("scale", "alpha") and not (array > 0).all():
            raise RewardFileError(f"{where}: {name} must be above 0; train the reward again.")


def describe(
    learned: LearnedReward, half_extent: float | None, unit: str | None, provenance: dict[str, Any]
) -> str:
    """The description as JSON text; a `ConfigError` if its choices are wrong or are no JSON."""
    about = {
        "format": FORMAT,
        "version": VERSION,
        "encoder": encoder.to_json(learned.config),
        "activity": learned.activity._asdict(),
        "classes": [*learned.classes],
        "robots": [*learned.robots],
        "objects": [*learned.objects],
        "half_extent": half_extent,
        "unit": unit,
        "provenance": {"gril_jax": _version(), **provenance},
    }
    if learned.params.head is not None:
        about["head"] = heads.name_of(learned.params.head)
    _check_choices(learned, half_extent)
    return _json(about)


def check_version(about: dict[str, Any], where: str) -> None:
    """Raises a RewardFileError unless the description is one of this format, of a version known."""
    kind, version = about.get("format"), about["version"]
    if kind != FORMAT:
        raise RewardFileError(f"{where} has format {kind!r:.60}; it must be {FORMAT!r}.")
    if type(version) is not int or version != VERSION:
        raise RewardFileError(
            f"{where} has version {version!r:.60}, but this version of gril-jax reads "
            f"{VERSION}: save it again."
        )


def understand(about: Mapping[str, Any], where: str) -> LearnedReward:
    """The reward that a description defines, with shapes in place of arrays; a RewardFileError for
    a field that is missing, a ConfigError for a choice that this version does not have."""
    try:
        config = encoder.from_json(about["encoder"])
        rule = activity_rule.from_json(about["activity"])
        _require_whole(about, {"encoder": encoder.to_json(config), "activity": PAPER._asdict()})
        learned = LearnedReward(
            blank(config, _head(about)),
            config,
            *(_names(about, field) for field in ("classes", "robots", "objects")),
            activity=rule,
            description=_json(about),
        )
        _check_choices(learned, _positive(about, "half_extent"))
        _check_words(about)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
    except KeyError as error:
        raise RewardFileError(
            f"{where}: the description lacks the field {error}; save the reward again."
        ) from None
    return learned


def _check_choices(learned, half_extent):
    count, classes = getattr(learned.config, "num_classes", None), learned.classes
    if count is not None and len(classes) != count:
        raise ConfigError(
            f"classes holds {len(classes)} names but encoder.num_classes is {count}; they must be "
            "as many."
        )
    if len(set(classes)) < len(classes):
        raise ConfigError(f"classes is {', '.join(classes)}; its names must differ.")
    _positive({"half_extent": half_extent}, "half_extent")


def _positive(about, field):
    value = about[field]
    if value is not None and not (type(value) in (int, float) and 0 < value < 1e30):
        raise ConfigError(f"{field} is {value!r:.60}; it must be a number above 0, or None.")
    return None if value is None else float(value)


def _head(about):
    head = about.get("head")
    if not (head is None or isinstance(head, str)):
        raise ConfigError(f"head is {head!r:.60}; it must be the name of a method, or None.")
    return head


def _names(about, field):
    names = about[field]
    if not (isinstance(names, list) and all(is_printable(name) for name in names)):
        raise ConfigError(f"{field} is {names!r:.60}; it must be a list of printable names.")
    return tuple(names)


def _require_whole(about, wanted):
    """Raises KeyError for a field that is missing: its default may be another than the writer's."""
    for part, fields in wanted.items():
        missing = (f"{part}.{name}" for name in fields if name not in about[part])
        if lacks := [name for name in missing if name not in _LATER]:
            raise KeyError(lacks[0])


def _check_words(about):
    unit, provenance = about["unit"], about["provenance"]
    if not (unit is None or is_printable(unit)):
        raise ConfigError(f"unit is {unit!r:.60}; it must be printable text, or None.")
    if not isinstance(provenance, dict):
        raise ConfigError(f"provenance is {provenance!r:.60}; it must be an object with fields.")


def _version():
    try:
        return importlib.metadata.version("gril-jax")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def _json(content):
    try:
        return json.dumps(content, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"provenance and unit must be JSON, but {error}.") from None


def packed(arrays: Mapping[str, np.ndarray], description: str) -> bytes:
    """A whole file with these arrays and this text; equal contents give equal bytes."""
    ordered = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    stream = io.BytesIO()
    np.savez(stream, **ordered, description=np.array(description))
    return sealed(stream.getvalue())


def sealed(archive: bytes) -> bytes:
    """The zip archive with its digest as its comment."""
    stream = io.BytesIO(archive)
    with zipfile.ZipFile(stream, "a") as file:
        file.comment = bytes(_DIGITS)
    body = stream.getvalue()[:-_DIGITS]
    return body + hashlib.sha256(body).hexdigest().encode()
