"""Checkpoints: the arrays of a state, written by Orbax, beside a manifest of digests.

    FOLDER/000000001000/arrays/         Orbax, one folder a leaf
    FOLDER/000000001000/manifest.json   step; shape, dtype and SHA-256 of each leaf and file

A checkpoint is written under another name and renamed when it is complete, so that one which is
cut short is never chosen. Files are verified before Orbax reads them, leaves after. Typed keys
are stored as their data. Leaves come back bit for bit, on the default device; a weakly typed
leaf comes back strongly typed.
"""

import contextlib
import errno
import hashlib
import json
import logging
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from absl import logging as absl_logging

from .errors import RunError
from .run_dir import writing

__all__ = ["latest", "manifest", "restore", "save", "steps"]

_FORMAT = 1


def save(folder: Path, step: int, state: Any, *, keep: int | None = None) -> Path:
    """Writes a checkpoint and returns its folder.

    Args:
      folder: where a run's checkpoints go; created where it lacks.
      step: at least 0, and new to the folder.
      state: any pytree of arrays and numbers; typed keys are welcome.
      keep: how many of the newest checkpoints stay; None keeps all.

    Raises:
      RunError: the step exists already, or the disk is full or not writable.
    """
    final = folder / f"{step:012d}"
    if final.exists():
        raise RunError(f"checkpoint {final} exists already, but a step is saved once")
    part = folder / f".{final.name}.part"
    entries, arrays = _describe(state)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(part, ignore_errors=True)  # left by a process that was killed
        try:
            _write_arrays(part / "arrays", arrays)
            content = {
                "format": _FORMAT,
                "step": step,
                "leaves": entries,
                "files": _files(part),
            }
            (part / "manifest.json").write_text(_with_digest(content), encoding="utf-8")
            os.rename(part, final)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    for old in steps(folder)[:-keep] if keep else ():
        shutil.rmtree(folder / f"{old:012d}")
    return final


def restore(path: Path, like: Any) -> Any:
    """Reads a checkpoint back.

    Args:
      path: what `save` or `latest` returned.
      like: a state of the same structure, shapes and dtypes; its values are not used.

    Raises:
      RunError: the checkpoint is missing, damaged, or of another structure than `like`.
    """
    content = manifest(path)
    entries = content["leaves"]
    _check_structure(path, entries, like)
    _check_files(path, content["files"], entries)
    arrays = _read_arrays(path, entries)
    leaves = []
    for entry, old in zip(entries, jax.tree.leaves(like), strict=True):
        array = arrays.get(entry["file"])
        if array is None:  # Orbax stores no array without elements
            array = np.zeros(entry["shape"], jnp.dtype(entry["dtype"]))
        same = array.dtype == jnp.dtype(entry["dtype"]) and list(array.shape) == entry["shape"]
        if not same or _digest(array) != entry["sha256"]:
            raise RunError(f"checkpoint {path} is damaged: leaf {entry['path']} has changed")
        leaves.append(_unpack(array, old))
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


def steps(folder: Path) -> list[int]:
    """The steps of the complete checkpoints in a folder, oldest first."""
    if not folder.is_dir():
        return []
    found = (p for p in folder.iterdir() if re.fullmatch(r"\d{12}", p.name))
    return sorted(int(p.name) for p in found if (p / "manifest.json").is_file())


def latest(folder: Path) -> Path | None:
    """The newest complete checkpoint in a folder, or None where there is none."""
    found = steps(folder)
    return folder / f"{found[-1]:012d}" if found else None


def manifest(path: Path) -> dict[str, Any]:
    """A checkpoint's step and leaves, without reading the arrays.

    Raises:
      RunError: there is no checkpoint, or its manifest is damaged.
    """
    file = path / "manifest.json"
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        digest = content.pop("sha256")
    except FileNotFoundError:
        raise RunError(f"{path} is not a complete checkpoint: it has no manifest.json") from None
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        raise RunError(f"checkpoint {path} is damaged: its manifest cannot be read") from None
    if digest != hashlib.sha256(_canonical(content)).hexdigest():
        raise RunError(f"checkpoint {path} is damaged: its manifest has changed")
    if content["format"] != _FORMAT:
        raise RunError(
            f"checkpoint {path} has format {content['format']}, but this version reads {_FORMAT}"
        )
    return content


def _describe(state: Any) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """The manifest's entries, and the arrays by the name of their folder."""
    entries, arrays = [], {}
    for index, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(state)):
        array, file = _pack(leaf), f"{index:05d}"
        entries.append(
            {
                "path": _name(path),
                "file": file,
                "shape": list(array.shape),
                "dtype": array.dtype.name,
                "key": _key_kind(leaf),
                "sha256": _digest(array),
            }
        )
        if array.size:
            arrays[file] = array
    return entries, arrays


def _check_structure(path: Path, entries: list[dict[str, Any]], like: Any) -> None:
    wanted = [(_name(place), leaf) for place, leaf in jax.tree_util.tree_leaves_with_path(like)]
    stored = {entry["path"] for entry in entries}
    for name, _ in wanted:
        if name not in stored:
            raise RunError(f"checkpoint {path} lacks the leaf {name} of the state it is to fill")
    for name in (entry["path"] for entry in entries):
        if name not in {name for name, _ in wanted}:
            raise RunError(f"checkpoint {path} has a leaf {name} that the state to fill lacks")
    for entry, (name, leaf) in zip(entries, wanted, strict=True):
        found = (entry["path"], entry["key"], entry["dtype"], tuple(entry["shape"]))
        packed = jax.eval_shape(_data, leaf)
        need = (name, _key_kind(leaf), packed.dtype.name, packed.shape)
        if found != need:
            raise RunError(
                f"leaf {entry['path']} of checkpoint {path} is {_words(found)}, but the "
                f"state to fill has {_words(need)} there"
            )


def _files(path: Path) -> dict[str, str]:
    """The digest of every file below a folder, by its path from there."""
    files = sorted(p for p in path.rglob("*") if p.is_file())
    return {
        p.relative_to(path).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files
    }


def _check_files(path: Path, digests: dict[str, str], entries: list[dict[str, Any]]) -> None:
    leaves = {entry["file"]: f"leaf {entry['path']}" for entry in entries}
    for name, digest in digests.items():
        leaf = leaves.get(Path(name).parts[1], name)  # arrays/00003/0.0 belongs to leaf 3
        try:
            data = (path / name).read_bytes()
        except OSError:
            raise RunError(f"checkpoint {path} is damaged: {leaf} is missing a file") from None
        if hashlib.sha256(data).hexdigest() != digest:
            raise RunError(f"checkpoint {path} is damaged: {leaf} has changed")


def _words(entry: tuple[str, str | None, str, tuple[int, ...]]) -> str:
    _, key, dtype, shape = entry
    return f"{f'a {key} key of ' if key else ''}{dtype}{list(shape)}"


def _name(path: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".") or "(root)"


def _key_kind(leaf: Any) -> str | None:
    """The generator of a typed key, or None for any other leaf."""
    return str(jax.random.key_impl(leaf)) if _is_key(leaf) else None


def _data(leaf: Any) -> Any:
    return jax.random.key_data(leaf) if _is_key(leaf) else jnp.asarray(leaf)


def _is_key(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _pack(leaf: Any) -> np.ndarray:
    return np.asarray(_data(leaf))


def _unpack(array: np.ndarray, like: Any) -> jax.Array:
    if _is_key(like):
        return jax.random.wrap_key_data(jnp.asarray(array), impl=jax.random.key_impl(like))
    return jnp.array(array)  # a copy: a donated buffer must not be NumPy's


def _digest(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def _canonical(content: dict[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True).encode()


def _with_digest(content: dict[str, Any]) -> str:
    digest = hashlib.sha256(_canonical(content)).hexdigest()
    return json.dumps({**content, "sha256": digest}, indent=1)


def _write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    path.parent.mkdir()
    if not arrays:  # Orbax refuses an empty tree
        return
    try:
        with _quiet(), _checkpointer() as checkpointer:
            checkpointer.save(path.absolute(), args=ocp.args.PyTreeSave(arrays))
    except ValueError as error:  # how TensorStore reports what the file system refuses
        full = re.search("No space|too large|quota", str(error))
        raise OSError(errno.ENOSPC if full else errno.EIO, str(error).split(": ")[-1]) from None


def _read_arrays(path: Path, entries: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    files = [entry["file"] for entry in entries if 0 not in entry["shape"]]
    if not files:
        return {}
    as_numpy = ocp.args.PyTreeRestore(
        restore_args={file: ocp.RestoreArgs(restore_type=np.ndarray) for file in files}
    )
    try:
        with _quiet(), _checkpointer() as checkpointer:
            return checkpointer.restore((path / "arrays").absolute(), args=as_numpy)
    except (ValueError, KeyError, OSError) as error:
        raise RunError(f"checkpoint {path} cannot be read by this version of Orbax") from error


def _checkpointer() -> ocp.Checkpointer:
    # One folder a leaf, so that damage to a file can be told by the leaf's name.
    return ocp.Checkpointer(ocp.PyTreeCheckpointHandler(use_ocdbt=False, use_zarr3=False))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Orbax logs each step of its work, and its errors before it raises them."""
    logger = absl_logging.get_absl_logger()
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
