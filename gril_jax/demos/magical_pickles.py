"""Reads frames of MAGICAL's public human demonstrations (`*.pkl.gz`) without running pickled code.

The files are pickles, which can name any function of any installed module and call it on loading.
This reader's unpickler knows six names, all mapped to stand-ins below that hold data; any other
name ends the reading. One file unpacks to about 107 MB.
"""

import gzip
import io
import os
import pathlib
import pickle
import zlib
from collections import OrderedDict, namedtuple
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt8

from gril_jax.errors import DemoError

from .folders import visible

FPS = 8.0
HALF_EXTENT = 1.02  # world units: half the width of the allocentric view
NUM_ACTIONS = 18  # 2 grips x 3 turns x 3 drives

_MAX_BYTES = 1 << 30  # unpacked; a file that grows beyond this is no demonstration
# What the pickle machine raises when fed bytes that are no pickle.
_MALFORMED = (pickle.UnpicklingError, ArithmeticError, AttributeError, EOFError, ImportError,
              LookupError, MemoryError, RecursionError, TypeError, ValueError)  # fmt: skip


class MagicalDemo(NamedTuple):
    """The part of one file that is kept."""

    frames: UInt8[np.ndarray, "T H W 3"]  # allocentric view, RGB, 8 a second
    env_name: str  # "MatchRegions-Demo-v0"
    score: float  # 1 is full success


def list_magical(folder: str | os.PathLike) -> list[pathlib.Path]:
    """The demonstration files of a folder, by name; raises `DemoError` where there is none."""
    paths = visible(pathlib.Path(folder), "*.pkl.gz")
    if not paths:
        raise DemoError(f"{folder}: the folder holds no *.pkl.gz file of MAGICAL's release.")
    return paths


def read_magical(path: str | os.PathLike) -> MagicalDemo:
    """Reads one file; raises `DemoError` for one that is missing, damaged or no demonstration."""
    content = _content(path)
    try:
        observations = content["trajectory"][1]
        frames = np.stack([step["allo"].array for step in observations])
        env_name, score = content["env_name"], float(content["score"])
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise DemoError(
            f"{path}: the pickle is no MAGICAL demonstration; it should hold 'trajectory' with "
            "equal frames under 'allo', 'score' and 'env_name'."
        ) from error
    if frames.dtype != np.uint8 or frames.ndim != 4 or frames.shape[-1] != 3:
        raise DemoError(
            f"{path}: frames are {frames.dtype} {frames.shape}, they should be uint8 (T, H, W, 3)."
        )
    if not isinstance(env_name, str):
        raise DemoError(f"{path}: 'env_name' should be text, not {type(env_name).__name__}.")
    return MagicalDemo(frames, env_name, score)


def read_actions(path: str | os.PathLike) -> Int[np.ndarray, "T"]:
    """The actions of one file, int64, each a flat number: 9 * grip + 3 * turn + drive.

    grip: 0 open, 1 close. turn: 0 none, 1 left, 2 right. drive: 0 none, 1 forward, 2 reverse.
    Action t leads from frame t to frame t + 1. Errors are those of `read_magical`.
    """
    content = _content(path)
    try:
        actions = content["trajectory"][0].array
    except (AttributeError, LookupError, TypeError) as error:
        raise DemoError(
            f"{path}: the pickle is no MAGICAL demonstration; it should hold 'trajectory', which "
            "begins with an array of actions."
        ) from error
    if actions.ndim != 1 or not actions.size or actions.dtype.kind not in "iu":
        raise DemoError(
            f"{path}: actions are {actions.dtype} {actions.shape}, they should be whole numbers "
            "(T,)."
        )
    wrong = actions[(actions < 0) | (actions >= NUM_ACTIONS)]
    if wrong.size:
        raise DemoError(f"{path}: action {wrong[0]} is none of 0 to {NUM_ACTIONS - 1}.")
    return actions.astype(np.int64)


def _content(path: str | os.PathLike) -> object:
    """The contents of the pickle, built of stand-ins."""
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe or a device may never end
        raise DemoError(f"{path}: the file cannot be read (no regular file).")
    try:
        with gzip.open(path) as file:
            data = file.read(_MAX_BYTES + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DemoError(f"{path}: not a whole gzip file ({error}).") from error
    except OSError as error:
        raise DemoError(f"{path}: the file cannot be read ({error.strerror}).") from error
    if len(data) > _MAX_BYTES:
        raise DemoError(f"{path}: unpacks to more than 1 GiB, a demonstration has about 107 MB.")
    try:
        return _Unpickler(data, path).load()
    except _MALFORMED as error:
        raise DemoError(f"{path}: not a whole pickle of a MAGICAL demonstration.") from error


class _DType:
    """Stands in for `numpy.dtype`: a plain number type, made when its byte order is known."""

    _CODES = frozenset({"b1", "u1", "i4", "i8", "f4", "f8"})

    def __init__(self, code: str, *_: object):
        if code not in self._CODES:
            raise pickle.UnpicklingError(f"dtype {code!r}")
        self.dtype = np.dtype(code)

    def __setstate__(self, state: tuple) -> None:
        if state[1] not in ("<", ">", "|", "="):
            raise pickle.UnpicklingError("byte order")
        self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Stands in for `numpy.ndarray`: reads its state as data, without trusting numpy's."""

    array: np.ndarray

    def __setstate__(self, state: tuple) -> None:
        _, shape, dtype, fortran, data = state
        self.array = np.frombuffer(data, dtype.dtype).reshape(shape, order="F" if fortran else "C")


def _frombuffer(
    data: bytes | bytearray, dtype: _DType, shape: tuple, order: str, *_: object
) -> _Array:
    if order not in ("C", "F"):
        raise pickle.UnpicklingError("memory order")
    array = _Array()
    array.__setstate__((1, shape, dtype, order == "F", data))
    return array


_Trajectory = namedtuple("_Trajectory", "acts obs rews infos")
_ALLOWED = {  # numpy 1 and numpy 2 name the same functions differently
    ("collections", "OrderedDict"): OrderedDict,
    ("numpy", "dtype"): _DType,
    ("numpy", "ndarray"): _Array,
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("numpy._core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("numpy.core.numeric", "_frombuffer"): _frombuffer,
    ("numpy._core.numeric", "_frombuffer"): _frombuffer,
    ("milbench.baselines.saved_trajectories", "MILBenchTrajectory"): _Trajectory,
    ("magical.saved_trajectories", "MAGICALTrajectory"): _Trajectory,
}


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, path: str | os.PathLike):
        super().__init__(io.BytesIO(data))
        self._path = path

    def find_class(self, module: str, name: str) -> object:
        if (module, name) not in _ALLOWED:
            raise DemoError(
                f"{self._path}: the pickle asks for {module}.{name}, which no demonstration "
                "needs; the file was not loaded, because loading it could run foreign code."
            )
        return _ALLOWED[module, name]
