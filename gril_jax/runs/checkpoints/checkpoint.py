"""Checkpoints: the arrays of a state, written by Orbax, beside a manifest of digests.

    FOLDER/000000001000/arrays/         Orbax, one folder a leaf
    FOLDER/000000001000/manifest.json   step; shape and dtype of each leaf; SHA-256 of each file;
                                        the mark of metrics.jsonl

The same state gives the same files, byte for byte.

A checkpoint is written under another name and renamed when all of it is on the disk. Files are
verified before Orbax reads them. Typed keys are stored as their data. Leaves come back bit for bit,
on the default device, and strongly typed. While training goes on a thread writes them.
"""

import contextlib
import ctypes
import errno
import functools
import hashlib
import logging
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from absl import logging as absl_logging

from gril_jax.errors import RunError
from gril_jax.runs.json_lines import Mark, with_digest
from gril_jax.runs.reading import require_unchanged
from gril_jax.safe_files import sync, writing

from . import FILE, DamagedError, latest, manifest, steps
from .state_leaves import Leaf, host_copy, leaf_name, like_of, to_device

# What Orbax notes beside the arrays: moments and paths, which it does without.
_NOTES = ("_CHECKPOINT_METADATA", "commit_success.txt")


def save(folder: Path, step: int, state: Any, **more: Any) -> Path:
    """Writes a checkpoint of a pytree as `write` does, and returns its folder."""
    return write(folder, step, host_copy(state), **more)


def write(
    folder: Path,
    step: int,
    leaves: Sequence[Leaf],
    *,
    keep: int | None = None,
    metrics: Mark | None = None,
) -> Path:
    """Writes a checkpoint from a copy on the host; one writer per folder at a time.

    Of those in the folder the `keep` newest stay, or all; a step that exists is a RunError. The
    manifest has the mark of the metrics at that time.
    """
    final, part = folder / f"{step:012d}", folder / f".{step:012d}.part"
    if (final / FILE).exists():
        raise RunError(f"checkpoint {final} exists already, but a step is saved once")
    entries = [
        {
            "path": leaf.path,
            "file": f"{index:05d}",  # the name of its folder
            "shape": list(leaf.array.shape),
            "dtype": leaf.array.dtype.name,
            "key": leaf.key,
        }
        for index, leaf in enumerate(leaves)
    ]
    # Orbax stores no array without elements.
    arrays = {f"{i:05d}": leaf.array for i, leaf in enumerate(leaves) if leaf.array.size}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for left in (*folder.glob(".*.part"), final):  # by a process that was killed
            shutil.rmtree(left, ignore_errors=True)
        try:
            _write_arrays(part / "arrays", arrays)
            files = _files(part)
            content = {"step": step, "leaves": entries, "files": files, "metrics": metrics}
            (part / FILE).write_text(with_digest(content), encoding="utf-8")
            for path in (*part.rglob("*"), part):
                sync(path)
            os.rename(part, final)
            sync(folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    if keep:
        keep_newest(folder, keep)
    return final


def keep_newest(folder: Path, count: int) -> None:
    """Removes all but the newest complete checkpoints, and what a process left that was killed."""
    with writing(folder):
        for old in steps(folder)[:-count]:
            os.rename(folder / f"{old:012d}", folder / f".{old:012d}.part")  # never a half
        for left in folder.glob(".*.part"):
            shutil.rmtree(left)


def restore(path: Path, like: Any) -> Any:
    """Reads a checkpoint back into the structure, shapes and dtypes of another state; a RunError if
    it has others, a DamagedError if a file is missing or has changed."""
    content = manifest(path)
    entries = content["leaves"]
    _check_structure(path, entries, like)
    _check_files(path, content["files"], entries)
    arrays = _read_arrays(path, entries)
    by_name, leaves = {entry["path"]: entry for entry in entries}, []
    for name, old in jax.tree_util.tree_leaves_with_path(like):
        entry = by_name[leaf_name(name)]
        empty = np.zeros(entry["shape"], jnp.dtype(entry["dtype"]))  # Orbax stores none of these
        leaves.append(to_device(arrays.get(entry["file"], empty), old))
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


def save_part(run: Path, part: str, step: int, state: Any) -> Path:
    """Saves a part of a run, such as "reward", in place of what a process that was cut off left.

    Returns the manifest, which covers all of it.
    """
    shutil.rmtree(run / part, ignore_errors=True)
    return save(run / part, step, state) / FILE


def save_arrays(file: Path, arrays: Mapping[str, Any]) -> None:
    """Writes arrays that are no state by their names to a .npz file, as `numpy.load` reads it."""
    np.savez(file, **arrays)


def newest(run: Path, part: str) -> Path:
    """The newest checkpoint of a part of a run, such as "reward"; a `RunError` without one, or
    if it is not as the run wrote it."""
    require_unchanged(run, f"{part}/")
    found = latest(run / part)
    if found is None:
        raise RunError(f"{run} has no {part}, so its run has not got that far yet")
    return found


def discard(path: Path) -> Path:
    """Renames a damaged checkpoint so that it is no longer listed; returns its new path."""
    aside = path.with_name(f"{path.name}.damaged")
    with writing(path.parent):
        shutil.rmtree(aside, ignore_errors=True)
        os.rename(path, aside)
    return aside


class CheckpointWriter:
    """Writes a state's checkpoints to one folder in a thread; closed by `with`, which waits for it.

    Only the copy to the host holds the training up, and one is being written at a time. What goes
    wrong in the thread is raised by the next call of any function. The `keep` newest ones stay.
    `before` is called in the thread ahead of each, to bring to the disk what it counts on; `mark`
    says how far the metrics have come as a state is handed over.
    """

    def __init__(
        self,
        folder: Path,
        *,
        keep: int,
        before: Callable[[], None] = lambda: None,
        mark: Callable[[], Mark | None] = lambda: None,
    ):
        self.longest_stall_s = 0.0  # that `save` held its caller up, waiting for another left out
        self._folder, self._keep, self._before, self._mark = folder, keep, before, mark
        self._threads = ThreadPoolExecutor(max_workers=1, thread_name_prefix="checkpoint")
        self._last: Future[None] | None = None

    @property
    def busy(self) -> bool:
        """True while a checkpoint is being written."""
        if self._last is not None and self._last.done():
            self.wait()
        return self._last is not None

    def save(self, step: int, state: Any) -> None:
        """Copies the state, then writes it in the thread; waits for the one before if necessary."""
        self.wait()
        begun, metrics = time.monotonic(), self._mark()
        leaves = host_copy(state)
        self.longest_stall_s = max(self.longest_stall_s, time.monotonic() - begun)

        def work() -> None:
            self._before()
            write(self._folder, step, leaves, keep=self._keep, metrics=metrics)
            _give_back_memory()

        self._last = self._threads.submit(work)

    def wait(self) -> None:
        """Returns once nothing is being written."""
        last, self._last = self._last, None
        if last is not None:
            last.result()

    def __enter__(self) -> "CheckpointWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # What went wrong first is what counts.
        with contextlib.suppress(Exception) if kind else contextlib.nullcontext():
            self.wait()
        self._threads.shutdown()


def _give_back_memory() -> None:
    """Returns freed memory to the system, where the C library can: it keeps a pool for each thread,
    of which Orbax starts new ones for each checkpoint."""
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        trim(0)


def _check_structure(path: Path, entries: list[dict[str, Any]], like: Any) -> None:
    wanted = {leaf_name(p): like_of(leaf) for p, leaf in jax.tree_util.tree_leaves_with_path(like)}
    stored = {e["path"]: (e["key"], e["dtype"], tuple(e["shape"])) for e in entries}
    if lacks := [name for name in wanted if name not in stored]:
        raise RunError(f"checkpoint {path} lacks the leaf {lacks[0]} of the state it is to fill")
    if has := [name for name in stored if name not in wanted]:
        raise RunError(f"checkpoint {path} has a leaf {has[0]} that the state to fill lacks")
    for name, found in stored.items():
        if found != wanted[name]:
            raise RunError(
                f"leaf {name} of checkpoint {path} is {_words(*found)}, but the state to fill "
                f"has {_words(*wanted[name])} there: it was saved with another configuration or "
                "by another version of gril-jax, which can read it"
            )


def _files(path: Path) -> dict[str, str]:
    """The digest of every file below a folder, by relative path."""
    files = {p.relative_to(path).as_posix(): p for p in sorted(path.rglob("*")) if p.is_file()}
    return {name: hashlib.sha256(p.read_bytes()).hexdigest() for name, p in files.items()}


def _check_files(path: Path, digests: dict[str, str], entries: list[dict[str, Any]]) -> None:
    leaves = {entry["file"]: f"leaf {entry['path']}" for entry in entries}
    for name, digest in digests.items():
        leaf = leaves.get(Path(name).parts[1], name)  # arrays/00003/0.0 belongs to leaf 3
        try:
            data = (path / name).read_bytes()
        except OSError:
            raise DamagedError(f"checkpoint {path} is damaged: {leaf} is missing a file") from None
        if hashlib.sha256(data).hexdigest() != digest:
            raise DamagedError(f"checkpoint {path} is damaged: {leaf} has changed")


def _words(key: str | None, dtype: str, shape: tuple[int, ...]) -> str:
    return f"{f'a {key} key of ' if key else ''}{dtype}{list(shape)}"


def _write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    path.parent.mkdir()
    if not arrays:  # Orbax refuses an empty tree
        return
    try:
        with _orbax() as checkpointer:
            checkpointer.save(path.absolute(), args=ocp.args.PyTreeSave(arrays))
        for name in _NOTES:
            (path / name).unlink(missing_ok=True)
    except ValueError as error:  # how TensorStore reports what the file system refuses
        # "...: Too many open files [os_error_code='24'] [tensorstore_spec='{...}']"
        said = str(error).partition(" [")[0].rpartition(": ")[2]
        known = re.search(r"os_error_code='(\d+)'", str(error))
        raise OSError(int(known[1]) if known else errno.EIO, said) from None


def _read_arrays(path: Path, entries: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    files = [entry["file"] for entry in entries if 0 not in entry["shape"]]
    if not files:
        return {}
    as_numpy = ocp.args.PyTreeRestore(
        restore_args={file: ocp.RestoreArgs(restore_type=np.ndarray) for file in files}
    )
    try:
        with _orbax() as checkpointer:
            return checkpointer.restore((path / "arrays").absolute(), args=as_numpy)
    except (ValueError, KeyError, OSError) as error:
        raise RunError(f"checkpoint {path} cannot be read by this version of Orbax") from error


@contextlib.contextmanager
def _orbax() -> Iterator[ocp.Checkpointer]:
    """Orbax, silenced: it logs each step, and its errors before it raises them."""
    # Of several processes that compute together, the one that writes does not wait for the others.
    me = jax.process_index()
    alone = ocp.options.MultiprocessingOptions(me, {me}, f"process-{me}")
    # One folder a leaf, so that damage to a file can be told by the leaf's name.
    handler = ocp.PyTreeCheckpointHandler(
        use_ocdbt=False, use_zarr3=False, multiprocessing_options=alone
    )
    loggers = absl_logging.get_absl_logger(), logging.getLogger("asyncio")
    before, hook = [logger.level for logger in loggers], sys.unraisablehook
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    sys.unraisablehook = functools.partial(_but_for_closed_loops, hook)
    with ocp.Checkpointer(handler, multiprocessing_options=alone) as checkpointer:
        yield checkpointer
    # Not after an error, of which the first is raised: files that were still being written then
    # have errors of their own, a little later.
    sys.unraisablehook = hook
    for logger, level in zip(loggers, before, strict=True):
        logger.setLevel(level)


def _but_for_closed_loops(hook: Callable[[Any], Any], lost: Any) -> None:
    """Hands on what is lost, but for the error of a file whose checkpoint is given up."""
    if "Event loop is closed" not in str(lost.exc_value):
        hook(lost)
