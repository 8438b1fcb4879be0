"""Files of one's own tasks: what FILE.py:FUNCTION names, and whether it may be run.

FILE.py alone names its function, where it has a single public one.

A file is code, so it is run only where its user has named it: on this command line, or on an
earlier one with the very contents that it has now. Runs and configurations name files, too, and may
be somebody else's: that alone runs nothing. What was named is kept as the program `sha256sum`
writes it, in `gril_jax/tasks.sha256` below XDG_STATE_HOME, or `~/.local/state`.

Nothing here imports JAX. Whatever is wrong is a ValueError of one sentence.
"""

import ast
import contextlib
import hashlib
import importlib.abc
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from gril_jax.envs.checks import nearest

FAILURES = (Exception, SystemExit)  # whatever a user's code may raise; it must not end the process
_LARGEST = 10_000_000  # bytes; nobody's task is longer
_RAISED = "Traceback (most recent call last)"  # in what XLA says of a callback that failed

_named: dict[Path, str] = {}  # what this process was told to run: a file's digest
_moved: dict[Path, Path] = {}  # where a file of a run is now


class TaskError(ValueError):
    """A task of one's own breaks the contract, or its code fails; one sentence with its file."""


class Reference(NamedTuple):
    """A function of a Python file."""

    file: Path
    function: str

    def __str__(self) -> str:
        return f"{self.file}:{self.function}"


def is_reference(name: str) -> bool:
    """True if a task's name is that of a file, and not of a package or of the table."""
    return name.endswith(".py") or ".py:" in name


def reference(name: str, what: str = "task") -> Reference:
    """FILE.py:FUNCTION taken apart, or FILE.py, which is read, with an absolute path; a file whose
    function is named need not exist. `what` is said to be wrong in the sentence of a ValueError."""
    if not name.isprintable():
        raise ValueError(f"the {what} {name!r} has letters that cannot be printed")
    path, colon, function = name.rpartition(":")
    if name.endswith(".py"):
        path, function = name, ""
    elif not colon or not path.endswith(".py"):
        raise ValueError(f"the {what} {name!r} must be FILE.py:FUNCTION, such as my_{what}.py:make")
    file = Path(os.path.abspath(os.path.expanduser(path)))
    if not str(file).isprintable():
        raise ValueError(f"the {what} {name!r} is in {str(file.parent)!r}, which cannot be printed")
    function = function if path != name else _only_function(file, what)
    if not function.isidentifier():
        raise ValueError(f"the {what} {name!r} must end with the name of a function, such as :make")
    return Reference(file, function)


def _only_function(file: Path, what: str) -> str:
    """The single public function that a file defines; the file is not run."""
    source = _read(file, what)
    try:
        tree = ast.parse(source, str(file))
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"{file}, {fault(error, file)}") from None
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    found = [one.name for one in tree.body if isinstance(one, kinds) and one.name[0] != "_"]
    if len(found) != 1:
        have = f"the functions {', '.join(found)}" if found else "no public function"
        such = f"{file.name}:{found[0] if found else 'make'}"
        raise ValueError(f"{file} has {have}, so the {what} must be named as in {such}")
    return found[0]


def digest(name: str) -> str:
    """The SHA-256 of the file that a reference names."""
    return hashlib.sha256(_read(_place(reference(name)))).hexdigest()


def name(text: str) -> Reference:
    """Notes that the user has named this file, as it is now; returns its reference."""
    found = reference(text)
    source = _read(found.file)
    _named[found.file] = hashlib.sha256(source).hexdigest()
    entry, record = f"{_named[found.file]}  {found.file}\n", _record()
    with contextlib.suppress(OSError):  # what cannot be kept is asked for again
        if entry not in _entries(record):
            record.parent.mkdir(parents=True, exist_ok=True)
            with record.open("a", encoding="utf-8") as file:
                file.write(entry)
    return found


def moved(of_run: str, now: str) -> None:
    """Takes a file that the user names for the one of a run, which must have the same contents."""
    was = reference(of_run)
    _moved[was.file] = name(now).file


def look_for(of_run: str, sha256: str | None, places: Iterable[Path]) -> None:
    """Takes the first file with a run's digest for that of the run, if this is not where it was.

    It may be run if the user has named the same contents at the old place.
    """
    was = reference(of_run).file
    if sha256 is None or _place(reference(of_run)).exists():
        return
    for place in places:
        if place.name == was.name and place.is_file():
            now = Path(os.path.abspath(place))
            if hashlib.sha256(_read(now)).hexdigest() == sha256:
                _moved[was] = now
                if f"{sha256}  {was}\n" in _entries(_record()):
                    _named[now] = sha256
                return


def require(text: str, sha256: str | None = None) -> str:
    """The digest of a file that may be run; a ValueError if it may not, or is another one.

    Args:
      sha256: what a run has noted of the file; None where nothing has been.
    """
    found = reference(text)
    file = _place(found)
    if not file.exists():
        raise ValueError(
            f"the task file {file} does not exist: if it lies elsewhere now, say where with "
            f"--task FOLDER/{file.name}:{found.function}"
        )
    now = hashlib.sha256(_read(file)).hexdigest()
    if sha256 not in (None, now):
        raise ValueError(
            f"the task file {file} has been changed since the run began: put back what it was, or "
            f"begin a new run with --task {file}:{found.function}"
        )
    _require_named(file, now, found.function)
    return now


def load(text: str) -> Callable[..., Any]:
    """The function that a reference names; runs the file unless this process has done so."""
    found = reference(text)
    file = _place(found)
    source = _read(file)
    sha256 = hashlib.sha256(source).hexdigest()
    _require_named(file, sha256, found.function)
    known = f"gril_task_{hashlib.sha256(f'{file} {sha256}'.encode()).hexdigest()[:16]}"
    module = sys.modules.get(known) or _run(file, source, known)
    made = getattr(module, found.function, None)
    if made is None:
        public = [n for n in vars(module) if not n.startswith("_")]
        raise ValueError(f"{file} has no {found.function}{nearest(found.function, public)}")
    if not callable(made):
        raise ValueError(f"{file}: {found.function} is a {type(made).__name__}, not a function")
    return made


@contextlib.contextmanager
def guarded(what: str, file: Path) -> Iterator[None]:
    """Whatever the user's code raises in the block, or in a function that this decorates, is a
    TaskError that names `what`, the file and the line."""
    try:
        yield
    except TaskError:
        raise
    except FAILURES as error:
        said = fault(error, file)
        at = "at" if said.startswith("line ") else "with"
        raise TaskError(f"{file}: {what} failed {at} {said}") from error


def fault(error: BaseException, file: Path) -> str:
    """An exception in a few words, with the line of the user's file that it came from."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(file)]
    if isinstance(error, SyntaxError) and error.filename == str(file):
        lines = [error.lineno]
    said = _words(error)
    if _RAISED in said:  # of a callback: the last line says what, others where
        lines = re.findall(f'File "{re.escape(str(file))}", line ([0-9]+)', said)
        said = said.strip().splitlines()[-1]
    else:
        said = next((line.strip() for line in said.splitlines() if line.strip()), "")
        said = f"{type(error).__name__}{f': {said:.200}' if said else ''}"
    if isinstance(error, SystemExit):
        said = f"it called sys.exit({error.code!r:.60})"
    return f"{f'line {lines[-1]}: ' if lines else ''}{said:.240}".rstrip(". ")


def _words(error: BaseException) -> str:
    try:
        return str(error)
    except FAILURES:  # of a class of theirs
        return ""


def _place(found: Reference) -> Path:
    return _moved.get(found.file, found.file)


def _read(file: Path, what: str = "task") -> bytes:
    if not file.is_file():  # a pipe or a device would never end
        missing = "does not exist" if not file.exists() else "is no regular file"
        raise ValueError(f"the {what} file {file} {missing}")
    try:
        if file.stat().st_size > _LARGEST:
            raise ValueError(f"the {what} file {file} is too long for a program")
        return file.read_bytes()
    except OSError as error:
        raise ValueError(f"the {what} file {file} cannot be read ({error.strerror})") from None


def _require_named(file: Path, sha256: str, function: str) -> None:
    """Raises unless the user has named the file with these contents."""
    if _named.get(file) == sha256 or f"{sha256}  {file}\n" in _entries(_record()):
        return
    raise ValueError(
        f"the task file {file} was never named on a command line as it is now, so it is not run: "
        f"read it, and if you want it to run add --task {file}:{function}"
    )


def _record() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "gril_jax" / "tasks.sha256"


def _entries(record: Path) -> list[str]:
    try:
        return record.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError):
        return []


class _Loader(importlib.abc.SourceLoader):
    """Runs the bytes that were read, not a file of byte code beside them."""

    def __init__(self, file: Path, source: bytes):
        self.file, self.source = file, source

    def get_filename(self, fullname: str) -> str:
        return str(self.file)

    def get_data(self, path: Any) -> bytes:
        return self.source


def _run(file: Path, source: bytes, known: str) -> ModuleType:
    """The module of a file; it may import others from the folder it lies in."""
    loader = _Loader(file, source)
    spec = importlib.util.spec_from_loader(known, loader)
    module = importlib.util.module_from_spec(spec)
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # last: a file there stands in for nothing installed
    sys.modules[known] = module  # dataclasses look their module up
    try:
        loader.exec_module(module)
    except FAILURES as error:
        del sys.modules[known]
        raise ValueError(f"{file}, {fault(error, file)}") from error
    return module
