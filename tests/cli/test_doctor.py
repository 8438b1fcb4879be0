"""The doctor: every check is a row, whatever the process that it runs in does."""

from gril_jax.cli import heavy_imports, main
from gril_jax.cli.verbs import machine
from gril_jax.cli.verbs.machine import Check, probe, table


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


def test_what_is_needed_here_works_and_the_rows_cover_what_matters():
    rows = machine.check_all()
    assert all(row.works or not row.needed for row in rows), table(rows)
    names = {row.name for row in rows}
    assert {"python", "jax", "mujoco-mjx", "brax", "jax devices", "jax compiles"} <= names
    assert not any(row.needed for row in rows if row.name.startswith("MUJOCO_GL"))
    assert {"mjx", "video", "MUJOCO_GL=egl", "MUJOCO_GL=osmesa", "MUJOCO_GL=glfw"} <= names


def test_a_missing_package_is_broken(monkeypatch):
    monkeypatch.setattr(machine, "package_versions", lambda: {"jraph": "missing"})
    monkeypatch.setattr(machine, "probe", lambda name, *_, **__: Check(name, True, True, ""))
    rows = machine.check_all()
    assert Check("jraph", False, True, "missing") in rows


def test_a_backend_that_mujoco_cannot_be_imported_with_is_said(monkeypatch, tmp_path, capsys):
    def fails(name, *_):
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")

    def broken(name, *_, needed=True, **__):
        return Check(name, not name.startswith("MUJOCO"), needed, "AttributeError: glGetError")

    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(machine, "probe", broken)
    rows = {row.name: row for row in machine.check_all()}
    assert rows["MUJOCO_GL"].detail.startswith("MUJOCO_GL is 'osmesa', but MuJoCo cannot")
    for name in ("egl", "osmesa", "glfw"):
        assert rows[f"MUJOCO_GL={name}"].detail.startswith("nothing renders with")
    monkeypatch.setattr(heavy_imports, "import_module", fails)
    assert main.main(["demo", "--out", str(tmp_path / "film.mp4")]) == 2
    assert "gril: MUJOCO_GL is 'osmesa', but MuJoCo cannot" in capsys.readouterr().err
