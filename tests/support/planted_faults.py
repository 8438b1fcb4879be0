"""Damaged copies of an exported file, as bytes, each with its name."""

import io
import json
import pickle
import struct
import zipfile

import numpy as np

from gril_jax.export.reward_format import packed, sealed
from support.hostile import Writes


def faults(whole, trap, seed=0):
    """Yields (name, bytes) of damaged copies; what is unpickled from them creates the file `trap`.

    Those whose name begins with "sealed" have a digest that fits: only the checks behind it can
    refuse them.
    """
    rng = np.random.default_rng(seed)
    yield "empty", b""
    yield "zeros", bytes(len(whole))
    yield "text", b"observation_mean: 1\n" * 9
    yield "pickle", pickle.dumps(Writes(trap))
    yield "doubled", whole + whole
    yield "longer", whole + b"\0"
    for size in np.linspace(1, len(whole) - 1, 20).astype(int):
        yield f"cut to {size}", whole[:size]
    for place in rng.integers(len(whole), size=30):
        bit = int(rng.integers(8))
        changed = bytearray(whole)
        changed[place] ^= 1 << bit
        yield f"bit {bit} of byte {place}", bytes(changed)
    for start in rng.integers(len(whole) - 64, size=6):
        yield f"hole at {start}", whole[:start] + bytes(32) + whole[start + 32 :]
    yield from _other_contents(whole, trap)


def _other_contents(whole, trap):
    arrays = _arrays(whole)
    text = str(arrays.pop("description"))
    first = next(name for name, array in arrays.items() if array.ndim)
    content = arrays[first]

    def member(raw, name=first):
        return sealed(_zip(_members(whole) | {f"{name}.npy": raw}))

    changed = json.dumps(json.loads(text) | {"gril_jax": "9.9.9"})
    yield "description of another", _zip(_members(packed(arrays, changed)))
    yield "without a digest", _zip(_members(whole))
    for name in arrays:
        yield f"sealed without {name}", packed({n: a for n, a in arrays.items() if n != name}, text)
    yield "sealed with one more", packed(arrays | {"more": np.zeros(3, np.float32)}, text)
    yield "sealed another shape", packed(arrays | {first: np.zeros(77, np.float32)}, text)
    yield "sealed float64", packed(arrays | {first: content.astype(float)}, text)
    yield "sealed NaN", packed(arrays | {first: content * np.float32("nan")}, text)
    yield "sealed inf", packed(arrays | {first: content + np.float32("inf")}, text)
    yield "sealed a text for an array", packed(arrays | {first: np.array("0.5")}, text)
    yield "sealed no description", sealed(_zip(_members(whole), drop="description.npy"))
    for other in ("", "{", "[]", "7", "{}", "[" * 5000, json.dumps({"version": 2})):
        yield f"sealed description {other[:9]}", packed(arrays, other)
    trapped = io.BytesIO()
    np.save(trapped, np.array([Writes(trap)], object), allow_pickle=True)
    yield "sealed pickled object", member(trapped.getvalue())
    yield "sealed pickled description", member(trapped.getvalue(), "description")
    yield "sealed bare pickle", member(pickle.dumps(Writes(trap)))
    for shape in ((10**12,), (10**18, 10**18), (-1, 2**40), (3,), ("a",)):
        yield f"sealed shape {shape} declared", member(_npy("<f4", shape) + bytes(64))
    yield "sealed long text declared", member(_npy("<U999999999", ()) + bytes(64), "description")
    yield "sealed header without end", member(_npy("(" * 9000, ()))
    yield "sealed bomb", _bomb(whole, first)
    yield "sealed size of another", _lying(whole)


def _arrays(whole):
    with np.load(io.BytesIO(whole), allow_pickle=False) as file:
        return dict(file)


def _members(whole):
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _zip(members, drop=None):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, raw in members.items():
            if name != drop:
                archive.writestr(zipfile.ZipInfo(name), raw)
    return stream.getvalue()


def _npy(descr, shape):
    """The head of an .npy file, whatever it says."""
    head = repr({"descr": descr, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head


def _bomb(whole, first):
    """64 MB of zeros in the place of an array, deflated to 64 kB."""
    stream = io.BytesIO(_zip(_members(whole), drop=f"{first}.npy"))
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{first}.npy", _npy("<f4", (2**24,)) + bytes(2**26))
    return sealed(stream.getvalue())


def _lying(whole):
    """The list of contents gives the first array 4 GB."""
    body = bytearray(_zip(_members(whole)))
    entry = body.index(b"PK\x01\x02")
    body[entry + 20 : entry + 28] = b"\xfe\xff\xff\xff" * 2
    return sealed(bytes(body))
