"""A command on hostile inputs in a user's home: it ends in one sentence, and all stays as it was.

A case builds its files below the folder. Whatever the command does, what was there before is there
afterwards, and what is new lies in the output folder.
"""

import hashlib
import os
import signal

from gril_jax.cli.main import main

SECONDS = 120  # after which a command counts as hanging
IMPORT = "demos import-videos films --half-extent 1 --task match_regions".split()
COLOUR = "demos import-videos films --half-extent 1 --boxes colour --out new".split()
SET = ["000.mp4", "000.npz", "demos.json"]  # files of a set of one film
DEEP = "[" * 20_000
HUGE = (1 << 50,)


def contents(folder):
    """Every path below a folder, with the digest of a file and the target of a link."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = os.fsencode(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = path.is_dir()
    return found


def command(argv, capsys):
    """The exit code and standard error of a command line, which must not hang."""

    def hangs(*_):
        raise AssertionError(f"the command hangs: {argv}")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(SECONDS)
    try:
        code = main(argv)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return code, capsys.readouterr().err


def refused(home, argv, words, capsys):
    """The exit code of a command that ends in one sentence with these words, and leaves all as it
    was."""
    before = contents(home)
    code, said = command(argv, capsys)
    assert code in (1, 2), (code, said)
    last = said.strip().splitlines()[-1]
    assert last.startswith("gril: "), said
    assert last.endswith("."), said
    assert said.count("gril: ") == 1, said
    assert "Traceback" not in said
    assert len(last) < 1200, last
    assert words in said, said
    assert contents(home) == before
    return code


def films(home):
    """The folder that is imported."""
    folder = home / "films"
    folder.mkdir()
    return folder


def as_link(name, to):
    """Replaces a file of a folder by a link."""

    def change(folder):
        (folder / name).unlink()
        (folder / name).symlink_to(to)

    return change


def pipe(name):
    """Replaces a file of a folder by a pipe."""

    def change(folder):
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return change
