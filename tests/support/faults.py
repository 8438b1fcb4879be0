"""Faults planted in the files of a folder, and what a command makes of them.

A fault is refused in one sentence, or said; or the command does not read the file.
"""

import contextlib
import hashlib
import io
import shutil
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from gril_jax.cli import main as cli

_opened: set[str] | None = None  # while files are watched


def _watch(event, args):
    if event == "open" and _opened is not None and isinstance(args[0], str | Path):
        _opened.add(str(args[0]))


sys.addaudithook(_watch)


def _flipped(data, draw):
    changed = bytearray(data)
    changed[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return bytes(changed)


def _digit(data, draw):
    places = [i for i, x in enumerate(data) if 48 <= x <= 57]
    place = draw.choice(places) if places else 0
    return data[:place] + bytes([48 + (data[place] - 47) % 10]) + data[place + 1 :]


def _lines(data):
    return data.splitlines(keepends=True)


def _repeated(data, draw):
    lines = _lines(data)
    at = draw.randrange(len(lines))
    return b"".join([*lines[: at + 1], *lines[at:]])


def _swapped(data, draw):
    lines = _lines(data)
    if len(lines) > 1:
        one, other = draw.sample(range(len(lines)), 2)
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


# From a file's contents and a source of randomness to the damaged contents; None removes the file.
KINDS: dict[str, Callable] = {
    "a bit flipped": _flipped,
    "a digit changed": _digit,
    "cut short": lambda data, draw: data[: draw.randrange(len(data))],
    "emptied": lambda data, draw: b"",
    "deleted": lambda data, draw: None,
    "a line twice": _repeated,
    "two lines swapped": _swapped,
}


class Outcome(NamedTuple):
    """What a command came to."""

    code: int | None  # None if an error came through
    out: str
    err: str
    made: tuple  # digests of what it wrote


class Command(NamedTuple):
    """A command line on a run, whose copy is in the folder `work`; `out` is for what it writes."""

    run: Path
    args: Callable[[Path, Path], list[str]]  # from the run's copy and the folder for its output
    drawn: tuple[str, ...] = ()  # files that it writes into the run, and reads only then
    through: str = ""  # a sentence of the command that comes after all reading


def carried_out(command: Command, work: Path) -> Outcome:
    """Runs a command on the run's copy in the folder."""
    out = work / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    said, told = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
        try:
            code = cli.main(command.args(work / "run", out))
        except BaseException:
            code = None
            traceback.print_exc()
    files = [*sorted(p for p in out.rglob("*") if p.is_file())]
    files += [work / "run" / name for name in command.drawn if (work / "run" / name).is_file()]
    made = tuple(hashlib.sha256(p.read_bytes()).hexdigest() for p in files)
    return Outcome(code, said.getvalue(), told.getvalue(), made)


def files_read(command: Command, work: Path) -> tuple[list[str], Outcome]:
    """The files of the run that a command opens, and what it comes to.

    From a copy that has no others it comes to the same; else this fails.
    """
    global _opened
    _copied(command, work)
    before = {str(p.relative_to(work / "run")) for p in (work / "run").rglob("*") if p.is_file()}
    _opened = set()
    try:
        whole = carried_out(command, work)
    finally:
        opened, _opened = _opened, None
    inside = {str(Path(p).absolute()) for p in opened}
    before -= {*command.drawn}
    read = sorted(name for name in before if str((work / "run" / name).absolute()) in inside)
    _copied(command, work)
    for name in {*before, *command.drawn} - {*read}:
        (work / "run" / name).unlink(missing_ok=True)
    again = carried_out(command, work)
    assert (again.code, again.out, again.made) == (whole.code, whole.out, whole.made), again
    return read, whole


def _copied(command: Command, work: Path) -> None:
    shutil.rmtree(work / "run", ignore_errors=True)
    shutil.copytree(command.run, work / "run")


def planted(command: Command, work: Path, name: str, kind: str, draw) -> tuple[str, str] | None:
    """Plants a fault and runs the command; the verdict, and what was said.

    None where the fault changes nothing, such as a digit of a file without any. The verdict is
    refused, said, silent or traceback.
    """
    _copied(command, work)
    file = work / "run" / name
    data = file.read_bytes()
    if not data:
        return None
    damaged = KINDS[kind](data, draw)
    if damaged == data:
        return None
    if damaged is None:
        file.unlink()
    else:
        file.write_bytes(damaged)
    found = carried_out(command, work)
    text = found.out + found.err
    if found.code is None or "Traceback" in text:
        return "traceback", text
    faults = [line for line in found.err.splitlines() if line.startswith("gril: ")]
    if found.code and len(faults) == 1 and not (command.through and command.through in faults[0]):
        return "refused", faults[0]
    return ("said" if _said(found.out, file, work / "run") else "silent"), text


def _said(out: str, file: Path, run: Path) -> bool:
    """True if a line tells of a file, or of the checkpoint that it is of, that it is left out."""
    names = [str(file), *(str(above) for above in file.parents if run in above.parents)]
    told = [line for line in out.splitlines() if any(name in line for name in names)]
    return any(word in line for line in told for word in ("damaged", "left out"))
