"""Readers need time in proportion to what they read."""

import time

import pytest

from gril_jax.demos import schema
from gril_jax.demos.formats.record import Film
from gril_jax.demos.formats.table import read_csv
from gril_jax.errors import DemoError

FILM = [number / 10 for number in range(100)]
COLUMNS = "frame,class,x_min,y_min,x_max,y_max"
ENTRY = {
    "video": "0.mp4", "tracks": "0.npz", "frames": 5, "trimmed": 0, "outcome": "success",
    "objects": ["a"], "video_sha256": "", "tracks_sha256": "",
}  # fmt: skip


@pytest.fixture
def seconds():
    """A call gives the seconds since the test began; what is quadratic needs half a minute here."""
    begun = time.monotonic()
    return lambda: time.monotonic() - begun


def test_a_set_of_20_000_entries_is_checked_in_seconds(tmp_path, seconds):
    header = {
        "schema_version": 1, "task": "", "classes": ["a", *map(str, range(20_000))], "fps": 10.0,
        "half_extent": 1.0, "source": "", "robots": [*map(str, range(20_000))], "unit": None,
        "noise": None, "smoothing": 1, "demos": [ENTRY | {"name": str(i)} for i in range(20_000)],
    }  # fmt: skip
    assert schema.check_header(header, tmp_path) is header
    header["demos"].append(ENTRY | {"name": "7"})
    with pytest.raises(DemoError, match="two demonstrations are called '7'"):
        schema.check_header(header, tmp_path)
    assert seconds() < 5


@pytest.mark.parametrize(("columns", "cells"), [(100_000, 100_000), (0, 300_000)])
def test_a_table_of_100_000_columns_is_read_in_seconds(tmp_path, seconds, columns, cells):
    names = "".join(f",q{number}" for number in range(columns))
    first, *rest = [f"{frame},cup,1,1,5,5" for frame in range(100)]
    rows = [first + "," * cells, *(row + "," * columns for row in rest)]
    (tmp_path / "a.csv").write_text("\n".join([COLUMNS + names, *rows]))
    assert len(read_csv(tmp_path / "a.csv", Film(tmp_path / "a.mp4", FILM, 640, 480))) == 100
    assert seconds() < 5
