"""Metrics beside the file: TensorBoard's own reader, and a stand-in for Weights & Biases."""

import importlib.util
import sys
import types

import pytest

from gril_jax.config import RunConfig, RunSettings
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs import sinks as metric_sinks

ROWS = [
    {"phase": "pretrain", "step": 10, "loss": 0.5, "seconds": 1.0},
    {"phase": "ppo", "env_steps": 640, "success": 0.25, "score": None, "curve": [1.0]},
]


def test_a_row_s_numbers_go_under_phase_and_name_at_its_step():
    assert metric_sinks.scalars(ROWS[0]) == (10, {"pretrain/loss": 0.5, "pretrain/seconds": 1.0})
    assert metric_sinks.scalars(ROWS[1]) == (640, {"ppo/success": 0.25})
    assert metric_sinks.scalars({"x": 3}) == (None, {"run/x": 3.0})


def test_a_missing_package_is_told_with_what_installs_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    metric_sinks.require_installed([])
    with pytest.raises(ConfigError, match=r"'wandb', but the package wandb .*'gril-jax\[wandb\]'"):
        metric_sinks.require_installed(["wandb"])


@pytest.fixture
def spoken(monkeypatch):
    """A stand-in for a package of a sink; returns what it was told."""
    told = []

    def put(name, **members):
        module = types.ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: module)
        return told

    return put


class _Run:
    """Run of the stand-in for wandb: it counts steps as wandb does."""

    def __init__(self, told, step):
        self.told, self.step = told, step

    def log(self, numbers, step):
        self.told.append((step, numbers))
        self.step = step

    def finish(self):
        self.told.append("finished")


def _saved(run, *, after, rows):
    """Marks the rows as a checkpoint does."""
    if rows == after:
        run.cover("ppo")


def _config(*sinks):
    return RunConfig(run=RunSettings(sinks=sinks))


def test_rows_that_are_cut_leave_tensorboard_as_if_they_had_never_been(spoken, tmp_path):
    told = []

    class Writer:
        def __init__(self, folder, flush_secs):
            told.clear()  # the folder is new: what was told before is gone with the old one

        def add_scalar(self, *args):
            told.append(args)

        def close(self):
            pass

    spoken("tensorboardX", SummaryWriter=Writer)
    path = tmp_path / "run"
    with run_dir.create(path, _config("tensorboard"), device="cpu", experiment="train") as run:
        for i in range(3):
            run.log(phase="ppo", env_steps=10 * i, success=i / 10)
            _saved(run, after=2, rows=i + 1)
        assert len(told) == 3
    with run_dir.resume(path) as run:
        assert told == [("ppo/success", 0.0, 0), ("ppo/success", 0.1, 10)]
        run.log(phase="ppo", env_steps=20, success=0.7)
    assert told[-1] == ("ppo/success", 0.7, 20)
    assert len(told) == 3


def test_a_resumed_run_goes_on_in_wandb_under_its_old_identity(spoken, tmp_path):
    told, begun = [], []

    def init(**options):
        begun.append(options)
        return _Run(told, step=0 if len(begun) == 1 else 3)

    spoken("wandb", init=init)
    path = tmp_path / "run"
    with run_dir.create(path, _config("wandb"), device="cpu", experiment="train") as run:
        for i in range(3):
            run.log(phase="ppo", env_steps=10 * i, success=i / 10)
            _saved(run, after=2, rows=i + 1)
    wanted = [(i, {"ppo/success": i / 10, "ppo/step": 10 * i}) for i in range(3)]
    assert told == [*wanted, "finished"]
    told.clear()
    with run_dir.resume(path) as run:  # rows that wandb has already are not sent again
        run.log(phase="ppo", env_steps=20, success=0.2)
        run.log(phase="ppo", env_steps=30, success=0.3)
    assert told == [(3, {"ppo/success": 0.3, "ppo/step": 30}), "finished"]
    assert begun[0]["id"] == begun[1]["id"]
    assert begun[0]["config"]["run"]["sinks"] == ("wandb",)


def test_a_sink_that_cannot_start_is_one_sentence_and_gives_the_lock_back(spoken, tmp_path):
    def init(**_):
        raise ValueError("api_key not\nconfigured.")

    spoken("wandb", init=init)
    with pytest.raises(RunError, match=r"wandb cannot start \(api_key not configured\): log in"):
        run_dir.create(tmp_path / "run", _config("wandb"), device="cpu")
    with pytest.raises(RunError, match="wandb cannot start"):  # not: is being written
        run_dir.resume(tmp_path / "run")


def test_tensorboard_s_files_are_readable(tmp_path):
    pytest.importorskip("tensorboardX")
    sink = metric_sinks.open_sink("tensorboard", tmp_path, {}, ROWS[:1])
    sink.log(1, ROWS[1])
    sink.close()
    (file,) = (tmp_path / "tensorboard").iterdir()
    data = file.read_bytes()
    assert all(tag in data for tag in (b"pretrain/loss", b"pretrain/seconds", b"ppo/success"))
