"""A run's folder: what is in it, the lock, full disks, incomplete runs."""

import json
import math
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.config import PPOConfig, RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import reading, run_dir

CONFIG = RunConfig(ppo=PPOConfig(num_envs=32))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "one"


def _create(path):
    return run_dir.create(path, CONFIG, device="a test", command=["gril", "train", "a b"])


def _python(code, *args):
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, args)], capture_output=True, text=True
    )


# --- creating


def test_a_new_run_holds_its_configuration_and_versions(path):
    with _create(path) as run:
        assert run.path == path
        assert run.checkpoints.parent == path
    assert run_dir.read_config(path) == CONFIG
    versions = json.loads((path / "versions.json").read_text())
    assert versions["command"] == "gril train 'a b'"
    assert versions["device"] == "a test"
    assert versions["python"].startswith(f"{sys.version_info.major}.")
    assert versions["packages"]["jax"] == __import__("jax").__version__
    assert set(versions["packages"]) == set(reading.PACKAGES)


def test_a_run_never_takes_an_existing_folder(path):
    path.mkdir(parents=True)
    with pytest.raises(RunError, match="exists already, but the output must be a new folder"):
        _create(path)
    assert list(path.iterdir()) == []


def test_a_folder_that_appears_at_the_last_moment_is_not_taken(path, monkeypatch):
    path.mkdir(parents=True)
    real, looks = run_dir.require_new, []

    def blind_once(folder):
        looks.append(folder)
        if len(looks) > 1:
            real(folder)

    monkeypatch.setattr(run_dir, "require_new", blind_once)
    with pytest.raises(RunError, match="exists already"):
        _create(path)
    assert list(path.iterdir()) == []


def test_a_dangling_link_is_in_the_way(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(RunError, match="exists already"):
        run_dir.require_new(tmp_path / "link")


def test_a_folder_below_a_file_cannot_be_created(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"because .*file is a file, not a folder"):
        _create(tmp_path / "file" / "run")


def test_default_paths_of_one_second_differ(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run_dir.time, "strftime", lambda *_: "20300101-000000")
    first = run_dir.default_path(7)
    assert first.as_posix() == "runs/20300101-000000-seed7"
    first.mkdir(parents=True)
    assert run_dir.default_path(7).name == "20300101-000000-seed7-2"


# --- metrics and results


def test_metrics_are_readable_while_the_run_goes_on(path):
    with _create(path) as run:
        run.log(step=1, loss=0.5)
        assert run_dir.read_metrics(path) == [{"step": 1, "loss": 0.5}]
        run.log(step=2, loss=0.25)
        assert run_dir.read_metrics(path)[1] == {"step": 2, "loss": 0.25}


def test_numbers_of_numpy_and_jax_are_plain_in_the_file(path):
    with _create(path) as run:
        run.log(
            a=np.float32(0.5),
            b=jnp.int32(3),
            c=jnp.arange(2),
            d=np.bool_(True),
            e={"f": (1.5,)},
        )
    assert run_dir.read_metrics(path) == [
        {"a": 0.5, "b": 3, "c": [0, 1], "d": True, "e": {"f": [1.5]}}
    ]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, jnp.nan, np.float32("inf")])
def test_what_is_not_finite_becomes_null_and_the_file_stays_json(path, value):
    with _create(path) as run:
        run.log(loss=value, losses=np.array([1.0, value]))
    text = (path / "metrics.jsonl").read_text()
    assert json.loads(text, parse_constant=pytest.fail) == {"loss": None, "losses": [1.0, None]}


def test_results_say_that_a_run_has_finished(path):
    with _create(path) as run:
        with pytest.raises(RunError, match=r"has not finished: it lacks results\.json"):
            run_dir.read_results(path)
        run.finish({"success": np.float32(0.75), "curve": jnp.ones(2)})
    assert run_dir.read_results(path) == {"success": 0.75, "curve": [1.0, 1.0]}


# --- incomplete and foreign folders


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(RunError, match="does not exist, but must be the folder of a run"):
        run_dir.read_config(tmp_path / "nowhere")
    with pytest.raises(RunError, match=r"because it has no config\.yaml"):
        run_dir.read_config(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match="is a file, but must be the folder of a run"):
        run_dir.read_config(tmp_path / "file")


def test_a_damaged_configuration_is_named(path):
    _create(path).close()
    (path / "config.yaml").write_text("ppo:\n  num_envs: 0\n")
    with pytest.raises(RunError, match=r"config\.yaml: ppo\.num_envs is 0"):
        run_dir.resume(path)


def test_a_run_without_metrics_is_told(path):
    _create(path).close()
    (path / "metrics.jsonl").unlink()
    with pytest.raises(RunError, match=r"has no metrics yet: it lacks metrics\.jsonl"):
        run_dir.read_metrics(path)


# --- the lock

_HOLD = """
import pathlib, sys
from gril_jax.runs import run_dir
run = run_dir.resume(pathlib.Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_two_processes_never_write_to_one_run_and_a_dead_one_does_not_block(path):
    _create(path).close()
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(RunError, match=f"is being written by process {holder.pid}:"):
            run_dir.resume(path)
        assert run_dir.read_config(path) == CONFIG  # reading is always allowed
    finally:
        holder.kill()
        holder.communicate()
    assert (path / "lock").read_text() == f"{holder.pid}\n"  # the file is left, the lock is not
    run_dir.resume(path).close()


def test_one_process_does_not_write_to_a_run_twice_but_may_close_it_twice(path):
    with _create(path), pytest.raises(RunError, match="is being written by process"):
        run_dir.resume(path)
    run = run_dir.resume(path)
    run.close()
    run.close()


# --- full disks

_FILL = """
import pathlib, resource, sys
from gril_jax.runs import run_dir
from gril_jax.errors import RunError
path = pathlib.Path(sys.argv[1])
run = run_dir.resume(path)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # no file may grow beyond this
count = 0
try:
    while True:
        run.log(step=count, text="x" * 90)
        count += 1
except RunError as error:
    print(count, error)
run.close()
"""


def test_a_full_disk_is_one_sentence_and_what_was_written_stays_readable(path):
    _create(path).close()
    done = _python(_FILL, path)
    assert (done.returncode, done.stderr) == (0, "")
    count, _, sentence = done.stdout.partition(" ")
    assert sentence.startswith(f"there is no space left to write to {path} ")
    assert sentence.count("\n") == 1
    rows = run_dir.read_metrics(path)
    assert [row["step"] for row in rows] == list(range(int(count)))
    assert 0 < len(rows) < 10


def test_a_device_that_is_always_full_is_no_space_left(tmp_path):
    with (
        pytest.raises(RunError, match=r"no space left to write to .*No space left on device"),
        run_dir.writing(tmp_path),
        open("/dev/full", "w") as full,
    ):
        full.write("x")


def test_other_refusals_of_the_file_system_are_one_sentence_too(tmp_path):
    with (
        pytest.raises(RunError, match=r"cannot be written to .*Permission denied"),
        run_dir.writing(tmp_path),
    ):
        raise PermissionError(13, "Permission denied")


def test_a_run_with_a_link_in_it_does_not_go_on(path, tmp_path):
    """It would write where the link leads."""
    run_dir.create(path, CONFIG, device="a test", experiment="train").close()
    elsewhere = tmp_path / "mine.txt"
    elsewhere.write_text("mine")
    assert run_dir.require_resumable(path, "train") == CONFIG
    (path / "metrics.jsonl").unlink(missing_ok=True)
    (path / "metrics.jsonl").symlink_to(elsewhere)
    with pytest.raises(RunError, match=r"metrics.jsonl is a link, but a run goes on in files"):
        run_dir.require_resumable(path, "train")
    assert elsewhere.read_text() == "mine"
