"""One run's folder: its configuration, versions, metrics and results, and the lock on it.

    config.yaml      the resolved configuration; `gril train FOLDER/config.yaml` runs it again
    versions.json    package versions, Python, platform, device, command
    metrics.jsonl    one JSON object for each line, appended and flushed
    results.json     written when the run has finished
    checkpoints/     see `gril_jax.checkpoint`
    lock             held while a process writes to the folder; holds its process id

Neither JAX nor MuJoCo is imported here.
"""

import contextlib
import errno
import fcntl
import json
import math
import os
import platform
import shlex
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, TextIO

from .config import RunConfig
from .config_files import load, to_yaml
from .errors import ConfigError, RunError

__all__ = [
    "PACKAGES",
    "RunDir",
    "create",
    "default_path",
    "package_versions",
    "read_config",
    "read_metrics",
    "read_results",
    "require_new",
    "resume",
    "writing",
]

# What the numbers of a run can depend on; `gril doctor` shows the same list.
PACKAGES = (
    "gril-jax", "jax", "jaxlib", "flax", "optax", "jraph", "mujoco", "mujoco-mjx", "brax",
    "orbax-checkpoint", "numpy", "scipy", "opencv-python-headless", "av",
)  # fmt: skip

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class RunDir:
    """A run's folder, open for writing; made by `create` or `resume`, closed by `with`."""

    def __init__(self, path: Path, lock: TextIO):
        self.path = path
        self._lock = lock
        with writing(path):
            self._metrics = _open_lines(path / "metrics.jsonl")

    @property
    def checkpoints(self) -> Path:
        """Where checkpoints go."""
        return self.path / "checkpoints"

    def log(self, **metrics: Any) -> None:
        """Appends one line of metrics; arrays become lists, non-finite numbers become null.

        Raises:
          RunError: the disk is full or the folder not writable; earlier lines stay readable.
        """
        line = json.dumps({name: _plain(value) for name, value in metrics.items()})
        with writing(self.path):
            self._metrics.write(line + "\n")
            self._metrics.flush()

    def finish(self, results: Mapping[str, Any]) -> None:
        """Writes results.json, which says that the run has finished."""
        text = json.dumps({name: _plain(value) for name, value in results.items()}, indent=2)
        with writing(self.path):
            _write_whole(self.path / "results.json", text + "\n")

    def close(self) -> None:
        """Gives the lock back; closing twice is harmless."""
        with contextlib.suppress(OSError):  # a full disk was reported when the line was written
            self._metrics.close()
        self._lock.close()

    def __enter__(self) -> "RunDir":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def default_path(seed: int) -> Path:
    """A folder under `runs/`, named after the time and the seed, that does not exist yet."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-seed{seed}"
    path, count = Path("runs") / stem, 1
    while path.exists():
        count += 1
        path = Path("runs") / f"{stem}-{count}"
    return path


def create(
    path: Path, config: RunConfig, *, device: str, command: Sequence[str] | None = None
) -> RunDir:
    """Creates a run's folder, which must not exist, and opens it for writing.

    Args:
      path: the folder; folders above it are created where they lack.
      config: written as config.yaml.
      device: what the run computes on, in words.
      command: how the process was started; `sys.argv` where None.

    Raises:
      RunError: the folder exists, cannot be written, or the disk is full.
    """
    require_new(path)
    versions = {
        "packages": package_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "device": device,
        "command": shlex.join(sys.argv if command is None else command),
        "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            path.mkdir()  # exclusive, whatever happened since it was looked at
        except FileExistsError:
            require_new(path)
        lock = _take_lock(path)
        _write_whole(path / "versions.json", json.dumps(versions, indent=2) + "\n")
        _write_whole(path / "config.yaml", to_yaml(config))
    return RunDir(path, lock)


def resume(path: Path) -> RunDir:
    """Opens an existing run's folder for writing.

    Raises:
      RunError: it is not a run's folder, or another process is writing to it.
    """
    read_config(path)
    with writing(path):
        return RunDir(path, _take_lock(path))


def require_new(path: Path) -> None:
    """Raises RunError where something is in the way of a new folder."""
    if path.exists() or path.is_symlink():
        raise RunError(f"{path} exists already, but the output must be a new folder")
    above = next(p for p in path.absolute().parents if p.exists())
    if not above.is_dir():
        raise RunError(f"{path} cannot be created, because {above} is a file, not a folder")


def read_config(path: Path) -> RunConfig:
    """A run's configuration.

    Raises:
      RunError: it is not a run's folder, or its configuration is damaged.
    """
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise RunError(f"{path} {fault}, but must be the folder of a run")
    file = path / "config.yaml"
    if not file.is_file():
        raise RunError(f"{path} is not the folder of a run, because it has no config.yaml")
    try:
        return load(str(file))
    except ConfigError as error:
        raise RunError(str(error)) from None


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """A run's metrics so far, oldest first; a last line that was cut short is left out.

    Raises:
      RunError: the file is missing or a line before the last is damaged.
    """
    text = _read_text(path, "metrics.jsonl", "has no metrics yet")
    lines = text.split("\n")[:-1]  # what follows the last newline was cut short
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            rows.append(json.loads(line))
        except ValueError:
            raise RunError(f"{path / 'metrics.jsonl'}: line {number} is not JSON") from None
        if not isinstance(rows[-1], dict):
            raise RunError(f"{path / 'metrics.jsonl'}: line {number} must be an object")
    return rows


def read_results(path: Path) -> dict[str, Any]:
    """What a finished run came to.

    Raises:
      RunError: the run has not finished, or the file is damaged.
    """
    text = _read_text(path, "results.json", "has not finished")
    try:
        results = json.loads(text)
    except ValueError:
        raise RunError(f"{path / 'results.json'} is not JSON") from None
    if not isinstance(results, dict):
        raise RunError(f"{path / 'results.json'} must be an object with fields")
    return results


def package_versions() -> dict[str, str]:
    """The installed version of each package in `PACKAGES`, or "missing"."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turns what the file system refuses into a RunError of one sentence."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise RunError(
                f"there is no space left to write to {folder} ({error.strerror}): what was "
                "written so far stays readable"
            ) from None
        raise RunError(f"{folder} cannot be written to ({error.strerror or error})") from None


def _take_lock(path: Path) -> TextIO:
    """The kernel drops the lock with the process that holds it, so none is ever left behind."""
    lock = open(path / "lock", "a+", encoding="utf-8")  # closed by RunDir
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise RunError(
            f"{path} is being written by process {holder}: wait for it or give another folder"
        ) from None
    lock.truncate(0)
    lock.write(f"{os.getpid()}\n")
    lock.flush()
    return lock


def _open_lines(file: Path) -> TextIO:
    """Opens for appending, after cutting off a line that was left incomplete."""
    if file.exists():
        data = file.read_bytes()
        os.truncate(file, data.rfind(b"\n") + 1)
    return open(file, "a", encoding="utf-8")


def _write_whole(file: Path, text: str) -> None:
    """The file appears complete or not at all."""
    part = file.with_name(f".{file.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)


def _read_text(path: Path, name: str, fault: str) -> str:
    read_config(path)
    try:
        return (path / name).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise RunError(f"the run in {path} {fault}: it lacks {name}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{path / name} cannot be read ({error})") from None


def _plain(value: Any) -> Any:
    """Numbers, strings and lists of them, from Python's, NumPy's or JAX's."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
