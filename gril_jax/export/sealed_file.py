"""The bytes of an exported file: float32 arrays, a description, and a digest over both.

It is an npz file, uncompressed, whose zip comment is the SHA-256 of all bytes before it: so any
flipped bit is noticed, also where zip does not look. `unpack` of `gril_jax.export.read_policy`
reads it.
"""

import hashlib
import io
import zipfile
from collections.abc import Mapping

import numpy as np

_DIGITS = 64


def packed(arrays: Mapping[str, np.ndarray], description: str) -> bytes:
    """A whole file with these arrays and this text; equal contents give equal bytes."""
    ordered = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    stream = io.BytesIO()
    np.savez(stream, **ordered, description=np.array(description))
    return sealed(stream.getvalue())


def sealed(archive: bytes) -> bytes:
    """The zip archive with its digest as its comment."""
    stream = io.BytesIO(archive)
    with zipfile.ZipFile(stream, "a") as file:
        file.comment = bytes(_DIGITS)
    body = stream.getvalue()[:-_DIGITS]
    return body + hashlib.sha256(body).hexdigest().encode()
