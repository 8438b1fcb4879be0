"""Plays a policy file of `gril export`; this one file and NumPy are all that a robot needs.

    policy = load_policy("policy.npz")
    action = policy(observation)  # one observation (O,) or many (..., O)

    act = policy.episode()  # a policy that sees which objects have moved, and remembers them
    action = act(observation_without_those_bits, center, size)

A file that is damaged, cut short or edited is a ValueError of one sentence. Nothing is unpickled or
inflated, and no array is larger than the file itself. The file's last 64 bytes, the comment
of its zip, are the SHA-256 of all bytes before them.
"""

import collections
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

_ACTIVATIONS = {
    "swish": lambda x: x * (1 + np.tanh(x / 2)) / 2,
    "relu": lambda x: np.maximum(x, 0),
    "tanh": np.tanh,
    "none": lambda x: x,
}


_NO_BITS = {"objects": [], "tau": 0.0, "window": 1, "smoothing": 1, "noise": None}


class Policy:
    """The deterministic policy of a file: policy(observation (..., O)) is the action (..., A)."""

    def __init__(self, about: dict[str, Any], arrays: dict[str, np.ndarray]):
        self.about = about  # the file's description
        self._arrays = arrays

    def __call__(self, observation: Any) -> np.ndarray:
        arrays, x = self._arrays, np.asarray(observation, np.float32)
        mean, limit = arrays["observation_mean"], arrays["observation_limit"]
        if x.shape[-1:] != mean.shape:
            raise ValueError(f"observation has shape {x.shape}; its last axis must be {len(mean)}")
        x = np.clip(x - mean, -limit, limit)
        for i, layer in enumerate(self.about["layers"]):
            x = x @ arrays[f"kernel_{i}"] + arrays[f"bias_{i}"]
            x = _ACTIVATIONS[layer["activation"]](x)
        start, stop = self.about["output"]["mean"]
        return np.tanh(x[..., start:stop])

    def episode(self) -> Callable[[Any, Any, Any], np.ndarray]:
        """The policy for one episode: act(own, center, size) is the action (A,) of a control step.

        `own` (O - N,) is the observation without activity bits. `center` and `size` (N, 2) are the
        boxes, in world units, of `about["activity"]["objects"]`. The bits are computed from them as
        `gril_jax.graphs.activity` does; a box that is not finite has not moved. Without such bits
        in the file, N is 0.
        """
        rule = _NO_BITS | (self.about.get("activity") or {})
        count, window, median = len(rule["objects"]), rule["window"], rule["smoothing"]
        recent, past = collections.deque(maxlen=median), collections.deque(maxlen=window)
        active, origin, frame = np.zeros(count, bool), None, -1
        # The variance of the difference of two medians, in five deviations.
        jitter = (rule["noise"] or 0.0) ** 2 * 25 * np.pi / (median + np.pi / 2 - 1)

        def act(own, center=(), size=()):
            nonlocal origin, frame
            center, size = (np.reshape(x, (-1, 2)).astype(np.float32) for x in (center, size))
            if not len(center) == len(size) == count:
                raise ValueError(
                    f"center and size must have the {count} boxes of {rule['objects']}"
                )
            recent.extend([center] * (1 if recent else median))
            center, frame = np.median(recent, axis=0).astype(np.float32), frame + 1
            if frame < median:  # the first frames find where an object is
                origin = center
            before = origin if frame < window + median - 1 else past[0]
            away = np.square(center - before).sum(1)
            threshold = np.float32(rule["tau"]) ** 2 * np.square(size).sum(1)
            active[:] |= (away > np.fmax(threshold, np.float32(jitter))) & np.isfinite(away)
            past.append(center)
            return self(np.concatenate([np.asarray(own, np.float32), active]))

        return act


def load_policy(path: str | os.PathLike) -> Policy:
    """The policy of a file, checked; errors are ValueErrors of one sentence."""
    about, arrays = unpack(path)
    try:
        _check_policy(about, arrays)
    except Exception as error:
        why = str(error)[:99] or type(error).__name__
        raise ValueError(f"{path} is no policy file ({why}): export it again") from None
    return Policy(about, arrays)


def unpack(path: str | os.PathLike) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The description and the float32 arrays of an exported file; a ValueError if it is damaged."""
    with open(path, "rb") as file:
        raw = file.read()
    try:
        whole = hashlib.sha256(raw[:-64]).hexdigest().encode() == raw[-64:]
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = archive.infolist()
            _require(sum(member.file_size for member in members) <= len(raw), "it would inflate")
            _require(not any(member.compress_type for member in members), "it is compressed")
            arrays = {m.filename.removesuffix(".npy"): _array(archive.read(m)) for m in members}
        _require(len(arrays) == len(members), "two arrays have one name")
        _require("description" in arrays, "it has no description")
        about = json.loads(str(arrays.pop("description")), parse_constant=_no_number)
        _require(isinstance(about, dict) and "version" in about, "its description has no version")
        _require_printable(about)
        _require(whole, "its digest is another")
        for name, array in arrays.items():
            _require(array.dtype == np.float32, f"{name} is not float32")
            _require(np.isfinite(array).all(), f"{name} is not finite")
    except Exception as error:
        why = str(error)[:99] or type(error).__name__
        raise ValueError(f"{path} is cut short or damaged ({why}): export it again") from None
    return about, arrays


def _array(raw):
    """The numbers or the text of an .npy file, as a view of its bytes."""
    stream = io.BytesIO(raw)
    _require(np.lib.format.read_magic(stream) == (1, 0), "an array is of another format")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    _require(dtype.str == "<f4" or (dtype.kind, shape) == ("U", ()), f"an array holds {dtype.str}")
    _require(not fortran, "an array's axes are in another order")
    _require(all(type(n) is int and n >= 0 for n in shape), "an array has an impossible shape")
    return np.frombuffer(raw, dtype, offset=stream.tell()).reshape(shape)


def _no_number(text):
    raise ValueError(f"its description has the number {text}")


def _require_printable(value):
    """Nothing in the description is a letter that a terminal would obey."""
    if isinstance(value, str):
        shown = value.translate(dict.fromkeys(map(ord, "\n\u200c\u200d")))
        _require(shown.isprintable(), f"its description has {value!r:.40}")
    elif isinstance(value, dict | list):
        for one in [*value, *value.values()] if isinstance(value, dict) else value:
            _require_printable(one)


def _check_policy(about, arrays):
    """Each layer takes what the one before it gives, and nothing is missing or left over."""
    version = (about["format"], about["version"])
    known = version == ("gril-jax policy", 2) and type(about["version"]) is int
    _require(known, "it holds a {}, version {}".format(*version))
    wanted, size = {}, about["layers"][0]["in"]
    wanted["observation_mean"] = wanted["observation_limit"] = (size,)
    for i, layer in enumerate(about["layers"]):
        _require(type(layer["out"]) is int and layer["in"] == size, f"layer {i} does not fit")
        _require(layer["activation"] in _ACTIVATIONS, f"layer {i} has no known activation")
        size = layer["out"]
        wanted[f"kernel_{i}"], wanted[f"bias_{i}"] = (layer["in"], size), (size,)
    found = {name: array.shape for name, array in arrays.items()}
    _require(found == wanted, f"its arrays have the shapes {found}")
    start, stop = about["output"]["mean"]
    _require(type(start) is type(stop) is int and 0 <= start < stop <= size, "no such output")
    _require(about["output"]["squash"] == "tanh", "its output is squashed by no known function")
    _check_range(arrays, len(about["layers"]))
    rule = about.get("activity")
    if rule is not None:
        _require(type(rule["objects"]) is list, "its objects are no list")
        _require(type(rule["window"]) is int and 0 < rule["window"] <= 2**20, "no such window")
        _require(type(rule["tau"]) in (int, float) and 0 <= rule["tau"] <= 1e6, "no such tau")
        median, noise = rule.get("smoothing", 1), rule.get("noise")
        _require(type(median) is int and 0 < median < 100 and median % 2, "no such smoothing")
        known = noise is None or (type(noise) in (int, float) and 0 <= noise <= 1e6)
        _require(known, "no such noise")


def _check_range(arrays, layers):
    """No observation can give a number that float32 does not hold."""
    most = arrays["observation_limit"].astype(float)
    _require((most > 0).all(), "observation_limit is not above 0")
    for i in range(layers):
        most = most @ np.abs(arrays[f"kernel_{i}"].astype(float)) + np.abs(arrays[f"bias_{i}"])
        _require((most < np.finfo(np.float32).max).all(), f"the numbers of layer {i} overflow")


def _require(holds, otherwise):
    if not holds:
        raise ValueError(otherwise)
