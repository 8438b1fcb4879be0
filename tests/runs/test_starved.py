"""Full disks, folders that must not be written, no descriptors left, closed output, signals.

Each ends in one sentence or is said, and what was cut off goes on to the folder of a run that
nothing disturbed.
"""

import contextlib
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import gril_jax.envs
import pytest
from support import new_task
from support.killed import killer
from support.run_folders import differing
from support.tiny_runs import command

_ARGS = command("pretrain")
_AGAIN = ("pretrain", "--resume", "run")


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """What runs command lines on a task as small as can be."""
    folder = tmp_path_factory.mktemp("task")
    new_task.write(folder, new_task.AUDITED)
    with killer(folder) as found:
        yield found


@pytest.fixture(scope="module")
def whole(killed, tmp_path_factory):
    """The folder of a run that nothing disturbed, and how often it changed its files."""
    folder = tmp_path_factory.mktemp("whole")
    assert killed.run(folder, _ARGS).code == 0
    return folder / "run", killed.changes(folder)


def _goes_on(killed, folder, whole):
    """A run that was cut off comes to the same folder as one that was not."""
    path = folder / "run"
    args = _AGAIN
    if (path / "results.json").exists():
        args = ("report", "run")
    elif not (path / "config.yaml").exists():
        shutil.rmtree(path, ignore_errors=True)
        args = _ARGS
    done = killed.run(folder, args)
    assert done.code == 0, done
    left = {*differing(whole[0], path)}
    assert left <= {"lock"}, left


def _said(done, words):
    """A command ended in one sentence of its own."""
    assert "Traceback" not in done.err, done.err
    assert done.code in (1, 2), done
    assert done.sentence.startswith("gril: "), done.err
    assert done.sentence.endswith("."), done.err
    assert any(word in done.sentence for word in words), done.err


_LEAST, _MOST = 600, 60_000  # bytes


@pytest.mark.slow
def test_files_that_must_not_grow_end_in_a_sentence_and_the_run_goes_on(killed, whole, tmp_path):
    draw, ends = random.Random(0), []
    for number in range(8):
        folder = tmp_path / str(number)
        most = int(_LEAST * (_MOST / _LEAST) ** draw.random())
        done = killed.run(folder, _ARGS, limits={"FSIZE": most})
        ends.append(done.code)
        if done.code:
            _said(done, ("no space left",))
        _goes_on(killed, folder, whole)
    assert 1 in ends


@pytest.mark.slow
def test_a_full_disk_ends_in_a_sentence_and_the_run_goes_on(killed, whole, tmp_path):
    """A disk of its own that is too small at first: needs root."""
    ends = []
    for kilobytes in (16, 40, 80, 160, 320, 640):
        folder = tmp_path / str(kilobytes)
        folder.mkdir()
        disk = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder)]
        if os.getuid() or subprocess.run(disk, capture_output=True).returncode:
            pytest.skip("no disk can be mounted here")
        try:
            done = killed.run(folder, _ARGS)
            ends.append(done.code)
            more = ["mount", "-o", "remount,size=64m", str(folder)]
            subprocess.run(more, check=True)
            if done.code:
                _said(done, ("no space left",))
            _goes_on(killed, folder, whole)
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=True)
    assert 1 in ends


@pytest.mark.slow
def test_a_folder_that_must_not_be_written_is_a_sentence(killed, whole, tmp_path):
    """Permissions do not bind root, but a read-only mount does."""
    folder = tmp_path / "mine"
    with _read_only(folder / "locked"):
        done = killed.run(folder, [*_ARGS, "--out", "locked/run"])
        _said(done, ("locked/run cannot be written to (Read-only file system)",))
        assert not [*(folder / "locked").iterdir()]
    assert killed.run(folder, _ARGS, change=whole[1] // 2).code == -signal.SIGKILL
    with _read_only(folder / "run"):
        _said(killed.run(folder, _AGAIN), ("Read-only file system",))
    _goes_on(killed, folder, whole)


@contextlib.contextmanager
def _read_only(folder):
    folder.mkdir(parents=True, exist_ok=True)
    bound = ["mount", "--bind", str(folder), str(folder)]
    if os.getuid() or subprocess.run(bound, capture_output=True).returncode:
        pytest.skip("nothing can be mounted here")
    try:
        subprocess.run(["mount", "-o", "remount,bind,ro", str(folder)], check=True)
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.slow
def test_without_descriptors_a_run_ends_in_a_sentence_and_goes_on(killed, whole, tmp_path):
    ends = []
    for most in (7, 8, 9, 10, 12, 16, 24, 40):
        folder = tmp_path / str(most)
        done = killed.run(folder, _ARGS, limits={"NOFILE": most})
        ends.append(done.code)
        if done.code:
            _said(done, ("Too many open files", "too many open files"))
        _goes_on(killed, folder, whole)
    assert 1 in ends


@pytest.mark.slow
@pytest.mark.parametrize("stdout", ["closed", "full", "gone"])
def test_output_that_nobody_can_read_loses_nothing(killed, whole, tmp_path, stdout):
    done = killed.run(tmp_path, _ARGS, stdout=stdout)
    assert "Traceback" not in done.err, done.err
    assert done.code in (0, 1), done
    _goes_on(killed, tmp_path, whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    "signals",
    [
        (signal.SIGTERM,), (signal.SIGHUP,), (signal.SIGINT,), (signal.SIGINT,) * 2,
        (signal.SIGTERM, signal.SIGINT),
    ],
    ids=["SIGTERM", "SIGHUP", "SIGINT", "SIGINT twice", "SIGTERM and SIGINT"],
)  # fmt: skip
def test_signals_at_any_moment_lose_nothing(killed, whole, tmp_path, signals):
    draw, codes = random.Random(0), []
    for number in range(4):
        folder = tmp_path / str(number)
        change = draw.randrange(1, whole[1])
        done = killed.run(folder, _ARGS, change=change, signals=signals)
        codes.append(done.code)
        assert "Traceback" not in done.err, done.err
        # Saved and said; or, in work that a resumed run does again, ended as signals end programs.
        ends = {0} | {code for number in signals for code in (128 + number, -number)}
        assert done.code in ends, done
        if done.code > 0:
            assert done.sentence.startswith("gril: "), done.err
        _goes_on(killed, folder, whole)
    assert any(codes)


_TWICE = """
import sys
from gril_jax.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_two_processes_in_one_folder_do_not_disturb_each_other(killed, whole, tmp_path):
    folder = tmp_path / "both"
    assert killed.run(folder, _ARGS, change=whole[1] // 3).code == -signal.SIGKILL
    environment = os.environ | {"PYTHONPATH": str(killed.path), "JAX_PLATFORMS": "cpu"}
    both = [
        subprocess.Popen(
            [sys.executable, "-c", _TWICE, *_AGAIN],
            cwd=folder, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for _ in range(2)
    ]  # fmt: skip
    said = [process.communicate(timeout=600) for process in both]
    codes = sorted(process.returncode for process in both)
    assert codes[0] == 0, said
    assert codes[1] in (1, 2), said  # it was refused before work, or as it began
    loser = next(err for (_, err), one in zip(said, both, strict=True) if one.returncode)
    assert "is being written by process" in loser or "has finished" in loser, loser
    assert differing(whole[0], folder / "run") == []


_GRIL = f"import sys; sys.argv[0] = 'gril'\n{_TWICE}"  # as versions.json has it
_BACKWARDS = """
import itertools, time
hours = itertools.count()
time.time = lambda: 2e9 - 3600 * next(hours)
"""


@pytest.mark.slow
def test_a_clock_that_goes_backwards_changes_nothing(killed, whole, tmp_path):
    """An hour at each look at it."""
    done = _mounted(tmp_path, _ARGS, PYTHONPATH=str(killed.path), script=_BACKWARDS + _GRIL)
    assert done.returncode == 0, done.stderr
    assert differing(whole[0], tmp_path / "run") == []
    rows = (tmp_path / "run" / "times.jsonl").read_text().splitlines()
    seconds = [row["seconds"] for row in map(json.loads, rows) if "seconds" in row]
    assert seconds == sorted(seconds)
    assert 0 < seconds[-1] < 600


@pytest.mark.slow
def test_a_read_only_checkout_is_enough(killed, whole, tmp_path):
    root = shlex.quote(str(Path(gril_jax.envs.__path__[0]).parent))
    locked = f"mount --bind {root} {root} && mount -o remount,bind,ro {root}"
    done = _mounted(tmp_path, _ARGS, locked, PYTHONPATH=str(killed.path))
    assert done.returncode == 0, done.stderr
    assert differing(whole[0], tmp_path / "run") == []


@pytest.mark.slow
def test_a_full_folder_for_temporary_files_is_a_sentence(tmp_path):
    (tmp_path / "small").mkdir()
    small = "mount -t tmpfs -o size=64k none small"
    made = ["demos", "make", "quickstart", "--num", "4", "--num-failures", "1", "--out", "set"]
    done = _mounted(tmp_path, made, small, TMPDIR=str(tmp_path / "small"))
    assert (done.returncode, "Traceback" in done.stderr) == (1, False), done.stderr
    assert "could not be written because there is no space left" in done.stderr
    assert not (tmp_path / "set").exists()


def _mounted(folder, args, mount="true", *, script=_GRIL, **environment):
    """A command line in a folder, with mounts that it alone sees; those need root."""
    run = f"{mount} && exec {shlex.join([sys.executable, '-c', script, *args])}"
    alone = [] if mount == "true" else ["unshare", "-m"]
    if alone and subprocess.run([*alone, "true"], capture_output=True).returncode:
        pytest.skip("nothing can be mounted here")
    return subprocess.run(
        [*alone, "sh", "-c", run], cwd=folder, capture_output=True, text=True, timeout=600,
        env=os.environ | {"JAX_PLATFORMS": "cpu"} | environment,
    )  # fmt: skip


@pytest.mark.slow
def test_memory_of_a_long_run_is_flat(killed, tmp_path):
    """Resident memory after a quarter of a run of thousands of chunks, and at its end."""
    args = [*command("train"), "--ppo.num-timesteps", "640000"]
    environment = os.environ | {"PYTHONPATH": str(killed.path), "JAX_PLATFORMS": "cpu"}
    process = subprocess.Popen(
        [sys.executable, "-c", _TWICE, *args, "--run.checkpoint-every", "5"],
        cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    rows, found = tmp_path / "run" / "metrics.jsonl", []
    while process.poll() is None:
        if rows.exists():
            with open(f"/proc/{process.pid}/statm") as file:
                pages = int(file.read().split()[1])
            found.append((rows.read_bytes().count(b"\n"), pages * os.sysconf("SC_PAGE_SIZE")))
        time.sleep(0.5)
    assert process.returncode == 0
    early, late = (min(x for n, x in found if n >= least) for least in (8000, 19000))
    print(f"{early / 2**20:.1f} MiB, then {late / 2**20:.1f}", flush=True)
    assert late - early < 2 * 2**20, (early, late)  # 0.4 kB kept of each would be 4.2 MiB
