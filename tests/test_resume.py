"""`gril VERB --resume RUN` and what it refuses; `runs/test_killed.py` shows that a run goes on."""

import contextlib
import importlib.util
import os
import random
import sys
import types

import pytest

from gril_jax import threads as parallel_map
from gril_jax.cli import arguments, heavy_imports
from gril_jax.cli import main as cli
from gril_jax.config import DemosConfig, EnvConfig, PPOConfig, RunConfig, RunSettings
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.runs.reading import read_phases, write_phases
from gril_jax.safe_files import digest


@pytest.fixture
def run(tmp_path):
    """A run of gril train that was cut off at once."""
    path = tmp_path / "run"
    config = RunConfig(ppo=PPOConfig(num_envs=32), run=RunSettings(seed=7))
    run_dir.create(path, config, device="cpu", experiment="train").close()
    return path


@pytest.fixture
def main(monkeypatch):
    """Puts a stand-in for the experiment of gril train in place and returns the calls."""
    calls = []
    module = types.ModuleType("gril_jax.workflows.train")
    module.main = lambda *args, **kwargs: calls.append((args, kwargs))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(module.__name__, module, raising=False)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    return calls


def _fault(capsys, *args):
    assert cli.main([*map(str, args)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


# --- the command line


@pytest.mark.parametrize("verb", ["train", "quickstart"])
def test_a_run_goes_on_with_its_own_configuration(main, run, verb):
    assert cli.main([verb, "--resume", str(run)]) == 0
    assert main == [((run_dir.read_config(run),), {"echo": arguments.echo, "resume": run})]


def test_options_that_say_what_the_run_says_are_welcome(main, run):
    assert cli.main(["train", f"--resume={run}", "--seed", "7", "--ppo.num-envs=32"]) == 0
    assert main[0][1]["resume"] == run


def test_a_set_that_was_moved_is_found_or_told(main, tmp_path, monkeypatch, capsys):
    sets = [tmp_path / name for name in ("mine", "hidden", "other")]
    for folder, text in zip(sets, ("a set", "a set", "another"), strict=True):
        folder.mkdir()
        (folder / "demos.json").write_text(text)
    monkeypatch.chdir(tmp_path)
    config = RunConfig(demos=DemosConfig(path="mine"))
    with run_dir.create(tmp_path / "run", config, device="cpu", experiment="train") as made:
        made.finish_phase("demos", {"sha256": digest(sets[0] / "demos.json")})
    monkeypatch.chdir("/")
    assert cli.main(["train", "--resume", str(tmp_path / "run")]) == 0
    assert main[-1][0][0].demos.path == str(sets[0])
    (sets[0] / "demos.json").unlink()
    said = _fault(capsys, "train", "--resume", tmp_path / "run")
    assert "is gone, but the run learns from it: if it lies elsewhere now, say where" in said
    moved = ("--demos", str(sets[1]))
    assert cli.main(["train", "--resume", str(tmp_path / "run"), *moved]) == 0
    assert main[-1][0][0].demos.path == str(sets[1])
    assert (tmp_path / "run" / "config.yaml").read_text().count("mine") == 1


def test_options_that_say_something_else_are_listed(run, capsys):
    err = _fault(capsys, "train", "--resume", run, "--seed=3", "--ppo.learning-rate", "1e-3")
    assert "but the command line gives " in err
    assert "run.seed (3, not 7), ppo.learning_rate (0.001, not 0.0003)" in err


def test_another_configuration_is_refused_by_its_fields(run, capsys):
    err = _fault(capsys, "train", "quickstart", "--resume", run)
    assert "run.seed (0, not 7)" in err
    assert "env.targets (['green square'], not ['green star', 'green square'])" in err


def test_the_configuration_by_its_own_file_is_welcome(main, run):
    assert cli.main(["train", str(run / "config.yaml"), "--resume", str(run)]) == 0
    assert len(main) == 1


def test_a_configuration_that_was_edited_is_refused_by_its_fields(run, capsys):
    file = run / "config.yaml"
    file.write_text(file.read_text().replace("num_envs: 32", "num_envs: 64"))
    err = _fault(capsys, "train", "--resume", run)
    assert "has been changed since the run began: ppo.num_envs (64, not 32)" in err


def test_a_run_that_has_finished_is_refused(run, capsys):
    with run_dir.resume(run) as opened:
        opened.finish({"success": 1.0})
    assert "has finished, so there is nothing to resume" in _fault(capsys, "train", "--resume", run)


def test_a_folder_that_is_no_run_is_refused(tmp_path, capsys):
    assert "has no config.yaml" in _fault(capsys, "train", "--resume", tmp_path)
    assert "does not exist" in _fault(capsys, "train", "--resume", tmp_path / "nowhere")
    assert "--resume is given without a value" in _fault(capsys, "train", "--resume")


def test_a_run_of_another_verb_is_refused(run, tmp_path, capsys):
    assert "was made by gril train, so gril pretrain" in _fault(capsys, "pretrain", "--resume", run)
    run_dir.create(tmp_path / "other", RunConfig(), device="cpu").close()  # of no verb
    assert "was made otherwise" in _fault(capsys, "train", "--resume", tmp_path / "other")


def test_a_run_that_is_being_written_is_refused(run, capsys):
    with run_dir.resume(run):
        err = _fault(capsys, "train", "--resume", run)
        assert (run / "lock").read_text() == f"{os.getpid()}\n"
    assert f"is being written by process {os.getpid()}" in err
    assert (run / "lock").read_text() == ""


def test_a_run_with_damaged_or_lost_phases_is_refused(run, capsys):
    file = run / "phases.json"
    file.write_text(file.read_text().replace("train", "trail"))
    assert "phases.json has been changed since the run wrote it" in _fault(
        capsys, "train", "--resume", run
    )
    file.unlink()
    assert "phases.json is missing, but the run had written it" in _fault(
        capsys, "train", "--resume", run
    )


def test_a_missing_package_of_a_sink_is_one_sentence_before_work_starts(monkeypatch, capsys):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    err = _fault(capsys, "train", "--run.sinks", "tensorboard", "wandb")
    assert "run.sinks names 'tensorboard', but the package tensorboardX is not installed" in err


def test_a_sink_that_does_not_exist_is_refused(capsys):
    err = _fault(capsys, "train", "--run.sinks", "tensorbord")
    assert "run.sinks is ['tensorbord'], but must be a list of tensorboard and wandb" in err
    err = _fault(capsys, "train", "--run.sinks", "wandb", "wandb")
    assert "run.sinks is ['wandb', 'wandb'], but must be a list of" in err


def test_an_arm_on_a_cpu_is_compiled_by_the_older_generator(monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    for task, flags in (
        ("match_regions", "a"),
        ("shoes_in_box", "a --xla_cpu_use_fusion_emitters=false"),
    ):
        monkeypatch.setenv("XLA_FLAGS", "a")
        monkeypatch.setattr(heavy_imports.metadata, "version", lambda name: "0.10.2")
        with heavy_imports.heavy_imports(RunConfig(env=EnvConfig(name=task))):
            assert os.environ["XLA_FLAGS"] == flags


def test_mjx_has_threads_to_spare_where_cores_are_few(monkeypatch):
    """On two, two Cholesky factorisations at once can wait for each other for ever."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    for env, cores, threads in (
        (EnvConfig(), 2, None),
        (EnvConfig(name="shoes_in_box"), 2, "4"),
        (EnvConfig(name="shoes_in_box"), 8, None),
        (EnvConfig(engine="mjx"), 2, "4"),
    ):
        monkeypatch.delenv("PJRT_NPROC", raising=False)
        monkeypatch.setattr(parallel_map, "cores", lambda n=cores: n)
        with heavy_imports.heavy_imports(RunConfig(env=env)):
            assert os.environ.get("PJRT_NPROC") == threads
    monkeypatch.setenv("PJRT_NPROC", "3")
    with heavy_imports.heavy_imports(RunConfig(env=EnvConfig(engine="mjx"))):
        assert os.environ["PJRT_NPROC"] == "3"


# --- phases.json


def test_finished_phases_are_kept_with_their_results(run):
    with run_dir.resume(run) as opened:
        assert opened.finished_phase("reward") is None
        opened.finish_phase("reward", {"tau": 0.5, "split": {"train": 3}})
    with run_dir.resume(run) as opened:
        assert opened.finished_phase("reward") == {"tau": 0.5, "split": {"train": 3}}
        assert opened.experiment == "train"


def test_no_flipped_bit_of_phases_goes_unnoticed(run):
    phases = read_phases(run)
    write_phases(run, phases)
    assert read_phases(run) == phases
    file, draw = run / "phases.json", random.Random(0)
    good = file.read_bytes()
    for _ in range(100):
        data = bytearray(good)
        data[draw.randrange(len(good))] ^= 1 << draw.randrange(8)
        file.write_bytes(data)
        with contextlib.suppress(RunError):  # white space between the values means nothing
            assert read_phases(run) == phases


def test_a_resumed_configuration_needs_what_a_new_one_needs(tmp_path, capsys):
    path, demos = tmp_path / "run", tmp_path / "demos"
    config = RunConfig(demos=DemosConfig(path=str(demos)))
    run_dir.create(path, config, device="cpu", experiment="train").close()
    assert "is gone, but the run learns from it" in _fault(capsys, "train", "--resume", path)
    said = _fault(capsys, "train", "quickstart", "--resume", path)
    assert "keeps the configuration" in said
    assert "env.targets (" in said
