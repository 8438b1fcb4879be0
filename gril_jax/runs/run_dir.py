"""One run's folder, open for writing: created, resumed, and closed.

    config.yaml      the resolved configuration; `gril train FOLDER/config.yaml` runs it again
    phases.json      the phases that have finished, see `gril_jax.runs.reading`
    versions.json    package versions, Python, platform, device, command, digest of a task's file
    metrics.jsonl    the metrics, see `gril_jax.runs.json_lines`
    times.jsonl      the clocks and where the run began: the one file in which two equal runs differ
    results.json     written when the run has finished
    checkpoints/     one folder a phase, see `gril_jax.runs.checkpoints.checkpoint`
    lock             see `take_lock` of `gril_jax.safe_files`

JAX is not imported here. Whatever is wrong with a run's folder, from a damaged file to a full disk,
is a `RunError`.
"""

import dataclasses
import hashlib
import itertools
import json
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from gril_jax.config import RunConfig
from gril_jax.config.files import to_yaml
from gril_jax.errors import RunError
from gril_jax.safe_files import digest, sync, take_lock, write_whole, writing

from . import checkpoints, places
from .json_lines import CLOCKS, TIMES, JsonLines, plain, read_rows, with_clocks
from .reading import Phases, marks_of, read_config, read_phases, versions, write_phases
from .reading import read_metrics as read_metrics
from .reading import read_results as read_results
from .sinks import open_sink

_RESULTS = "results.json"


class RunDir:
    """A run's folder, open for writing; made by `create` or `resume`, closed by `with`."""

    def __init__(self, path: Path, lock: TextIO, phases: Phases, config: RunConfig):
        self.path, self.checkpoints = path, path / "checkpoints"
        self.experiment = phases.experiment  # the one that can resume the run
        self.said: list[str] = []  # a sentence for each file that was repaired
        self._lock, self._phases, self._config = lock, phases, config
        self._place = path.stat()
        self._sinks: list[Any] = []
        self.rows, self.times = JsonLines(path / "metrics.jsonl"), JsonLines(path / TIMES)
        self.said += [said for said in (self.rows.said, self.times.said) if said]
        try:
            marks, damaged = marks_of(path, phases)
            self.said += damaged
            read_rows(self.rows.file, marks)  # they must be those that the run wrote
            if count := self.rows.cut(max((mark["lines"] for mark in marks), default=0)):
                self.said.append(
                    f"{count} lines of {self.rows.file} after the last checkpoint are left out: "
                    "their work is done again"
                )
            self.note_time(started=time.strftime("%Y-%m-%dT%H:%M:%S%z"))
            self._open_sinks()
        except BaseException:
            self.close()
            raise

    def _open_sinks(self) -> None:
        rows = self.metrics()
        self._count = len(rows)
        self._close_sinks()
        for name in self._config.run.sinks:
            config = dataclasses.asdict(self._config)
            self._sinks.append(open_sink(name, self.path, config, rows))

    def _close_sinks(self) -> None:
        while self._sinks:
            self._sinks.pop().close()

    def log(self, **metrics: Any) -> None:
        """Appends one line of metrics; arrays become lists, non-finite numbers become null.

        Its clocks, `gril_jax.runs.json_lines.CLOCKS`, go to times.jsonl.
        """
        self._require_here()
        row = plain(metrics)
        clocks = {name: row.pop(name) for name in CLOCKS if name in row}
        self.note_time(line=self._count + 1, **clocks)
        self.rows.append(row)
        for sink in self._sinks:
            sink.log(self._count, row | clocks)
        self._count += 1

    def sync(self) -> None:
        """Returns once the lines so far are on disk."""
        self._require_here()
        self.times.sync()
        self.rows.sync()

    def metrics(self) -> list[dict[str, Any]]:
        """The rows so far, with their clocks."""
        self._require_here()
        return with_clocks(read_rows(self.rows.file), self.path)

    def _require_here(self) -> None:
        """Raises RunError if the folder is not where the run was opened: its files would be split
        between two folders."""
        try:
            here = os.path.samestat(self._place, self.path.stat())
        except OSError:
            here = False
        if not here:
            raise RunError(
                f"the run's folder {self.path} was moved, renamed or deleted while the run wrote "
                f"to it: gril {self.experiment} --resume FOLDER goes on with it where it is now"
            )

    def note_time(self, **fields: Any) -> None:
        """Adds a line to times.jsonl, such as what a stage took."""
        self.times.append(plain(fields))

    def finished_phase(self, name: str) -> dict[str, Any] | None:
        """The results of a phase, or None while it has not finished."""
        return self._phases.finished.get(name)

    def finish_phase(
        self, name: str, results: Mapping[str, Any], files: Iterable[Path] = ()
    ) -> None:
        """Records that a phase has finished, so that a resumed run does not repeat it, with digests
        of what it has written into the run's folder."""
        finished = self._phases.finished | {name: dict(results)}
        self._phases = dataclasses.replace(self._phases, finished=finished)
        self.cover(name, files)

    def cover(self, phase: str, files: Iterable[Path] = ()) -> None:
        """Notes digests of a phase's files, and of the metrics so far, on disk."""
        with writing(self.path):
            files = [*files]
            self.sync()
            for file in files:
                sync(file)
            known = {file.relative_to(self.path).as_posix(): digest(file) for file in files}
            self._note(phase, known)

    def _note(self, phase: str, found: Mapping[str, str]) -> None:
        files = dict(self._phases.files)
        if found:
            files[phase] = files.get(phase, {}) | dict(found)
        metrics = self.rows.mark()
        self._phases = dataclasses.replace(self._phases, files=files, metrics=metrics)
        write_phases(self.path, self._phases)

    def save_part(self, part: str, step: int, state: Any) -> list[Path]:
        """Saves a part of the run, such as "reward"; returns the files that cover it."""
        self._require_here()
        return [checkpoints.save_part(self.path, part, step, state)]

    def load_part(self, part: str, like: Any) -> Any:
        """Reads a part back, into the structure of another; a RunError if it is damaged."""
        return checkpoints.restore(checkpoints.newest(self.path, part), like)

    def save_arrays(self, name: str, **arrays: Any) -> list[Path]:
        """Writes NumPy's arrays to a file of the folder; returns it in a list."""
        self._require_here()
        file = self.path / name
        with writing(self.path):
            checkpoints.save_arrays(file, arrays)
        return [file]

    def newest(self, phase: str, state: Any, tell: Callable[[str], None]) -> tuple[Any, int]:
        """The newest undamaged checkpoint of a phase and its chunks; the state and 0 without one.

        Damaged ones are set aside, and `tell` takes a sentence for each. The phase's rows of
        metrics after it are cut off. Where rows of other phases follow, as after a phase that has
        failed, all stay: of two rows of a step the later one counts.
        """
        chunks, mark = 0, None
        while (path := checkpoints.latest(self.checkpoints / phase)) is not None:
            try:
                state, chunks = checkpoints.restore(path, state), int(path.name)
                mark = checkpoints.manifest(path)["metrics"]
                break
            except checkpoints.DamagedError as error:
                aside = checkpoints.discard(path)
                tell(f"{error}: it is set aside as {aside.name}, and the one before it is taken")
        rows = read_rows(self.rows.file)
        after = range(mark["lines"] if mark else 0, len(rows))
        first = next((i for i in after if rows[i].get("phase") == phase), len(rows))
        alone = all(row.get("phase") == phase for row in rows[first:])
        if alone and self.rows.cut(first):
            self._open_sinks()
        return state, chunks

    def saving(self, phase: str, *, keep: int) -> "checkpoints.CheckpointWriter":
        """The writer of a phase's checkpoints, of which so many of the newest stay."""
        return checkpoints.CheckpointWriter(
            self.checkpoints / phase, keep=keep, before=self.sync, mark=self.rows.mark
        )

    def settle(self, phase: str) -> None:
        """Removes all but a phase's last checkpoint: how many there were is up to the clock."""
        checkpoints.keep_newest(self.checkpoints / phase, 1)

    def cut_off(self, where: str) -> str:
        """What is said of a run that a signal ends at some point."""
        how = f"gril {self.experiment} --resume {self.path} goes on with it"
        return f"the run is saved {where}: {how}"

    def finish(self, results: Mapping[str, Any]) -> None:
        """Writes results.json, which marks the run as finished."""
        text = json.dumps(plain(results), indent=2) + "\n"
        with writing(self.path):
            self.sync()
            # First the digest: a file without one could be damaged unnoticed.
            self._note("finished", {_RESULTS: hashlib.sha256(text.encode()).hexdigest()})
            write_whole(self.path / _RESULTS, text)

    def close(self) -> None:
        """Releases the lock; closing twice is harmless."""
        self._close_sinks()
        self.rows.close()
        self.times.close()
        if not self._lock.closed:
            self._lock.truncate(0)  # whoever has had it does not matter any more
            self._lock.close()

    def __enter__(self) -> "RunDir":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def default_path(seed: int) -> Path:
    """A path under `runs/`, named after the time and the seed, that does not exist yet."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-seed{seed}"
    paths = (Path("runs") / f"{stem}{f'-{n}' if n > 1 else ''}" for n in itertools.count(1))
    return next(path for path in paths if not path.exists())


def create(
    path: Path,
    config: RunConfig,
    *,
    device: str,
    command: Sequence[str] | None = None,
    experiment: str | None = None,
    begun: Mapping[str, Mapping[str, Any]] | None = None,
    first: Callable[[Path], Iterable[Path]] = lambda path: (),
) -> RunDir:
    """Creates a run's folder, which must not exist, and opens it for writing.

    Args:
      device: what the run computes on, in words.
      command: how the process was started; `sys.argv` where None.
      experiment: what can go on with the run if it is cut off; None if nothing can.
      begun: phases that have finished before the run began, with what they came to.
      first: writes files without which the folder is no run, and returns them.
    """
    require_new(path)
    require_text(path)
    made_with = versions(device, command)
    if config.env.digest is not None:
        made_with["task_sha256"] = config.env.digest
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            path.mkdir()  # exclusive, whatever happened since it was looked at
        except FileExistsError:
            require_new(path)
        lock = take_lock(path)
        write_whole(path / "versions.json", json.dumps(made_with, indent=2) + "\n")
        finished = {name: dict(results) for name, results in (begun or {}).items()}
        files = [path / "versions.json", *first(path)]
        known = {file.relative_to(path).as_posix(): digest(file) for file in files}
        phases = Phases(experiment, to_yaml(config), finished, {"begun": known})
        write_phases(path, phases)
        write_whole(path / "config.yaml", phases.config)  # last: it makes the folder a run
    run = RunDir(path, lock, phases, config)
    run.note_time(**places.here(path))
    return run


def resume(path: Path) -> RunDir:
    """Opens an existing run's folder for writing; its configuration must not have been changed."""
    config, phases = read_config(path), read_phases(path)
    with writing(path):
        lock = take_lock(path)
        for left in path.glob(".*.part"):  # by a process that was killed while it wrote
            left.unlink(missing_ok=True)
    return RunDir(path, lock, phases, config)


def require_resumable(path: Path, experiment: str, *, demos: Path | None = None) -> RunConfig:
    """The configuration of a run that an experiment can resume, see `read_config`; a `RunError` if
    it is no run, has finished, is of another experiment, was changed, or is being written."""
    require_text(path)
    config, phases = read_config(path, demos=demos), read_phases(path)
    if phases.experiment != experiment:
        made = f"by gril {phases.experiment}" if phases.experiment else "otherwise"
        raise RunError(f"{path} was made {made}, so gril {experiment} cannot go on with it")
    if (path / _RESULTS).exists():
        raise RunError(
            f"the run in {path} has finished, so there is nothing to resume: gril report makes its "
            "page again"
        )
    for file in path.iterdir():
        if file.is_symlink():
            raise RunError(f"{file} is a link, but a run goes on in files and folders of its own")
    with writing(path):
        take_lock(path, note=False).close()
    return config


def create_or_resume(
    config: RunConfig,
    folder: Path | None,
    *,
    device: str,
    experiment: str,
    begun: Mapping[str, Mapping[str, Any]] | None = None,
    first: Callable[[Path], Iterable[Path]] = lambda path: (),
) -> RunDir:
    """Resumes the run in a folder, or creates one at `config.run.out` if the folder is None.

    A run that goes on has its own `begun` and `first`; errors are those of `create` and
    `require_resumable`.
    """
    if folder is not None:
        require_resumable(folder, experiment)
        return resume(folder)
    out = Path(config.run.out) if config.run.out else default_path(config.run.seed)
    return create(out, config, device=device, experiment=experiment, begun=begun, first=first)


def require_text(path: Path) -> None:
    """Raises RunError if a folder's whole name is no text: no checkpoint could be written."""
    try:
        f"{path.absolute()}".encode()
    except UnicodeEncodeError:
        raise RunError(
            f"{path.absolute()} is no text in UTF-8, but a run's folder must be: rename it, or "
            "name another one with --out"
        ) from None


def require_new(path: Path) -> None:
    """Raises RunError if something exists at the path of a new folder."""
    if path.exists() or path.is_symlink():
        raise RunError(f"{path} exists already, but the output must be a new folder")
    above = next(p for p in path.absolute().parents if p.exists())
    if not above.is_dir():
        raise RunError(f"{path} cannot be created, because {above} is a file, not a folder")
