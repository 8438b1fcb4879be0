"""The doctor: every check is a row, whatever the process that it runs in does."""

import subprocess
import sys

import pytest

from gril_jax.cli import doctor
from gril_jax.cli.doctor import Check, exit_code, probe, table


def test_a_check_that_works_tells_what_it_printed_last():
    assert probe("x", "print('noise'); print('fine')", timeout_s=60) == Check(
        "x", True, True, "fine"
    )


def test_a_check_that_fails_tells_its_exception():
    row = probe("x", "raise ImportError('no such driver')", needed=False, timeout_s=60)
    assert row == Check("x", False, False, "ImportError: no such driver")


def test_a_complaint_of_the_clean_up_does_not_hide_the_exception():
    code = (
        "class Renderer:\n"
        "    def __init__(self): raise ValueError('the cause')\n"
        "    def __del__(self): raise TypeError('the echo')\n"
        "Renderer()\n"
    )
    assert probe("x", code, timeout_s=60).detail == "ValueError: the cause"


def test_a_check_that_crashes_is_a_row():
    code = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    assert probe("x", code, timeout_s=60) == Check("x", False, True, "stopped by signal 11")


def test_a_check_that_hangs_is_a_row():
    code = "import signal; signal.pause()"
    assert probe("x", code, timeout_s=0.5).detail == "no answer in 0.5 s"


def test_bytes_that_are_no_text_are_shown_somehow():
    code = r"import sys; sys.stdout.buffer.write(b'\xff\n')"
    assert probe("x", code, timeout_s=60).works


def test_a_rendering_check_chooses_its_backend():
    code = "import os; print(os.environ['MUJOCO_GL'], os.environ.get('PYOPENGL_PLATFORM'))"
    assert probe("x", code, timeout_s=60, gl_backend="egl").detail == "egl egl"
    assert probe("x", code, timeout_s=60, gl_backend="glfw").detail == "glfw None"


def test_each_backend_is_tried_and_none_is_needed(monkeypatch):
    monkeypatch.setattr(doctor, "_GL", "import os; print(os.environ['MUJOCO_GL'])")
    rows = doctor.gl_checks(timeout_s=60)
    assert [(row.detail, row.needed) for row in rows] == [
        ("egl", False),
        ("osmesa", False),
        ("glfw", False),
    ]


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        ([Check("a", True, True, "")], 0),
        ([Check("a", True, True, ""), Check("b", False, False, "")], 0),
        ([Check("a", False, True, ""), Check("b", True, True, "")], 1),
        ([], 0),
    ],
)
def test_only_what_is_needed_counts(rows, code):
    assert exit_code(rows) == code


def test_the_table_is_aligned():
    rows = [
        Check("a", True, True, "1.0"),
        Check("longer", False, True, "gone"),
        Check("b", False, False, ""),
    ]
    assert table(rows).splitlines() == [
        "a       ok        1.0",
        "longer  BROKEN    gone",
        "b       no",
    ]


def test_what_is_needed_here_works_and_the_rows_cover_what_matters():
    rows = doctor.check_all()
    assert exit_code(rows) == 0, table(rows)
    names = {row.name for row in rows}
    assert {"python", "jax", "mujoco-mjx", "brax", "jax devices", "jax compiles"} <= names
    assert {"mjx", "video", "MUJOCO_GL=egl", "MUJOCO_GL=osmesa", "MUJOCO_GL=glfw"} <= names


def test_a_missing_package_is_broken(monkeypatch):
    monkeypatch.setattr(doctor, "package_versions", lambda: {"jraph": "missing"})
    monkeypatch.setattr(doctor, "probe", lambda name, *_, **__: Check(name, True, True, ""))
    rows = doctor.check_all()
    assert Check("jraph", False, True, "missing") in rows
    assert exit_code(rows) == 1


def test_the_doctor_itself_imports_nothing_heavy():
    code = "import sys, gril_jax.cli.doctor; sys.exit(bool({'jax', 'mujoco'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
