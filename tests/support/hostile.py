"""A command on hostile inputs in a user's home: it ends in one sentence, and all stays as it was.

A case builds its files below the folder, some of which no honest tool writes. Whatever the command
does, what was there before is there afterwards, and what is new lies in the output folder.
"""

import hashlib
import io
import os
import pathlib
import signal
import struct
import zipfile

import av
import numpy as np

from gril_jax.cli.main import main

SECONDS = 120  # after which a command counts as hanging
IMPORT = "demos import-videos films --half-extent 1 --task match_regions".split()
COLOUR = "demos import-videos films --half-extent 1 --boxes colour --out new".split()
SET = ["000.mp4", "000.npz", "demos.json"]  # files of a set of one video
DEEP = "[" * 20_000
HUGE = (1 << 50,)
COLUMNS = "frame,class,x_min,y_min,x_max,y_max"
BOXES = f"{COLUMNS}\n0,goal,0,0,8,8\n0,green star,4,4,12,12\n"


def contents(folder):
    """Every path below a folder, with the digest of a file and the target of a link; what Python
    keeps of an imported module does not count."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if "__pycache__" in path.parts:
            continue
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


def film(path, shapes=((16, 16),) * 8, container="mp4", codec="libx264"):
    """Writes a video with one grey frame of each (height, width), eight a second."""
    with av.open(str(path), "w", format=container) as out:
        stream = out.add_stream(codec, rate=8)
        stream.height, stream.width = shapes[0]
        stream.pix_fmt = "yuv420p"
        for number, shape in enumerate(shapes):
            picture = np.full((*shape, 3), 8 * number % 256, np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        out.mux(stream.encode())
    return path


def changing(path):
    """A video that is two raw streams of different sizes, one after the other."""
    parts = [film(path.with_name(f"{side}.part"), ((side, side),) * 4, "h264") for side in (16, 32)]
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    for part in parts:
        part.unlink()


def sound(path):
    """A video without pictures."""
    with av.open(str(path), "w", format="mp4") as out:
        stream = out.add_stream("aac", rate=8000)
        block = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        block.sample_rate = 8000
        out.mux(stream.encode(block))
        out.mux(stream.encode())


def turned(path):
    """A video whose header says that it is to be shown turned by a quarter, as telephones do."""
    data = bytearray(film(path, ((16, 32),) * 8).read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40
    one = 1 << 16
    data[matrix : matrix + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


def npy(shape, dtype="<f4", data=b""):
    """An array file that says it has this shape, followed by whatever data there are."""
    stream = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_2_0(stream, header)
    return stream.getvalue() + data


def archive(path, method=zipfile.ZIP_DEFLATED, **members):
    """An npz file with these bytes as its members."""
    with zipfile.ZipFile(path, "w", method) as file:
        for name, contents in members.items():
            file.writestr(f"{name}.npy", contents)


def bomb(path, field, gigabytes=3):
    """An npz file of a few MB whose one array unpacks to gigabytes of zeros."""
    size = gigabytes << 30
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        with file.open(f"{field}.npy", "w", force_zip64=True) as member:
            member.write(npy((size // 4,)))
            for _ in range(size >> 26):
                member.write(bytes(1 << 26))


class Writes:
    """Pickles to a call that writes the file."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return pathlib.Path.write_text, (pathlib.Path(self.file), "this code was run")
