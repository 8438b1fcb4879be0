"""Nothing silent: a run that is cut off, and faults that are planted in a run's files."""

import collections
import contextlib
import random
import shutil
import sys

import pytest
from gril_jax.envs import registry
from support import new_task
from support.faults import KINDS, Command, files_read, planted
from support.run_folders import differing

from gril_jax.cli import main
from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import json_lines, run_dir
from gril_jax.runs.checkpoints import state_leaves
from gril_jax.workflows.learning import encoders, policies
from gril_jax.workflows.study import recipe, saved


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    """The configuration of a task as small as can be, whose policy's program is compiled once."""
    folder = tmp_path_factory.mktemp("task")
    config = new_task.write(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setitem(registry.TASKS, "reach", "reach_task:SPEC")
        for module in (policies, encoders):
            patch.setattr(module, "compiled_for", _compiled_once(module.compiled_for))
        yield config
    sys.modules.pop("reach_task", None)


def _compiled_once(compiled_for):
    """The same function, but what it has once compiled serves whoever asks later."""
    made = []

    def found(*args):
        if not made:
            made.append(compiled_for(*args))
        return made[0]

    return found


class CutOff(Exception):
    """Ends a run at once, as a kill would."""


@pytest.fixture(scope="module")
def whole(task, tmp_path_factory):
    """A run that nothing disturbed."""
    return _train(tmp_path_factory.mktemp("whole"), str(task), *_OPTIONS)


_OPTIONS = ("--run.checkpoint-every", "0", "--out", "run")


def _train(folder, *args):
    """`gril train` in a folder; the run's own."""
    with contextlib.chdir(folder):
        assert main.main(["train", *args]) == 0
    return folder / "run"


def _cut_off(folder, *args, before):
    """`gril train` in a folder, which ends before a call of a function; the run's own folder."""
    owner, name, when = before
    real = getattr(owner, name)

    def called(*args, **kwargs):
        if when(*args, **kwargs):
            raise CutOff
        return real(*args, **kwargs)

    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.setattr(owner, name, called)
        with pytest.raises(CutOff):
            main.main(["train", *args])
    return folder / "run"


def _of_phase(name):
    return lambda run, phase, *_: phase == name


def _row_of_policy(run, **metrics):
    return metrics.get("env_steps", 0) >= 48


_LOG = (run_dir.RunDir, "log", _row_of_policy)


@pytest.fixture(scope="module")
def cut(task, tmp_path_factory):
    """A run that was cut off while its policy was trained."""
    return _cut_off(tmp_path_factory.mktemp("cut"), str(task), *_OPTIONS, before=_LOG)


def test_a_run_that_was_cut_off_goes_on_to_the_same_folder(whole, cut, tmp_path, monkeypatch):
    shutil.copytree(cut, tmp_path / "run")
    for before in (
        (run_dir.RunDir, "finish_phase", _of_phase("policy")),
        (run_dir.RunDir, "finish_phase", _of_phase("evaluation")),
        (run_dir, "write_whole", lambda file, *_: file.name == "results.json"),
    ):
        _cut_off(tmp_path, "--resume", "run", before=before)
    _train(tmp_path, "--resume", "run")
    assert differing(whole, tmp_path / "run") == []
    page = (whole / "report.html").read_bytes()
    monkeypatch.chdir(whole.parent)  # its commands name the folder as it was given
    assert main.main(["report", whole.name]) == 0
    assert (whole / "report.html").read_bytes() == page


def _went_on(advance, begun, **_):
    """In place of training: a sentence on what it begins with."""
    raise RunError(f"went on after {begun.moves} chunks from {state_leaves.digest(begun.state)}")


def _study(path):
    """The run of a study with two rows, of which one has finished."""
    config = RunConfig()
    rows = dict.fromkeys(("environmental", "ours audited"), config)
    plan = saved.Plan(recipe.Study("mine"), config, rows, dict.fromkeys(rows, (0, 1)))
    known = {"device": "a test", "command": ["gril", "sweep"], "experiment": saved.EXPERIMENT}
    with run_dir.create(path, config, **known) as made:
        made.cover("begun", saved.write(path, plan))
        for steps in (10, 20):
            values = {of: [0.25, 0.75] for of in ("success", "success_sampled", "score")}
            made.log(phase="policy-0", env_steps=steps, seconds=steps, **values)
        made.finish_phase("policy-0", {"rows": [[0, 0], [0, 1]], "taus": [None, None]})
        made.finish({})
    return path


NAMES = (
    "eval", "report", "export", "export of a policy", "subtasks", "audit", "train --resume",
    "report of a study",
)  # fmt: skip
_PAGE = ("report.html", "demos.png")


def _commands(whole, cut, study):
    return {
        "eval": Command(whole, lambda run, out: ["eval", str(run), "--episodes", "1"]),
        "report": Command(
            whole, lambda run, out: ["report", str(run)], _PAGE
        ),
        "export": Command(
            whole, lambda run, out: ["export", str(run), "--out", str(out / "reward.npz")]
        ),
        "export of a policy": Command(
            whole,
            lambda run, out: [
                "export", str(run), "--what", "policy", "--out", str(out / "policy.npz"),
            ],
        ),
        "subtasks": Command(
            whole, lambda run, out: ["subtasks", str(run), "--out", str(out / "subtasks")]
        ),
        "audit": Command(
            whole, lambda run, out: ["audit", str(run), "--out", str(out / "audit")],
            through="has no stage definition",
        ),
        "train --resume": Command(
            cut, lambda run, out: ["train", "--resume", str(run)], through="went on after"
        ),
        "report of a study": Command(study, lambda run, out: ["report", str(run)], _PAGE[:1]),
    }  # fmt: skip


def _verdicts(command, work, kinds, most):
    """Plants each kind of fault in the files that a command reads, of those in folders in so many:
    how often it came to each verdict, and the faults that were taken in silence."""
    verdicts, bad, draw = collections.Counter(), [], random.Random(0)
    read, _ = files_read(command, work)
    read = [name for name in read if name != json_lines.TIMES]  # clocks, on which nothing depends
    inner = [file for file in read if "/" in file]
    outer = [file for file in read if "/" not in file]
    for file in [*outer, *draw.sample(inner, min(most, len(inner)))]:
        for kind in kinds:
            found = planted(command, work, file, kind, draw)
            if found is not None:
                verdicts[found[0]] += 1
                if found[0] in ("silent", "traceback"):
                    bad.append((file, kind, found[1]))
    return verdicts, bad


@pytest.fixture
def commands(whole, cut, tmp_path, monkeypatch):
    """Commands on these runs and on a study; one that goes on stops where training would begin."""
    monkeypatch.setattr(policies.loop, "run_chunks", _went_on)
    return _commands(whole, cut, _study(tmp_path / "study"))


@pytest.mark.parametrize("name", ["export", "train --resume"])
def test_faults_are_refused_or_said(commands, tmp_path, name):
    verdicts, bad = _verdicts(commands[name], tmp_path, ("a digit changed", "deleted"), most=3)
    assert not bad
    assert verdicts["refused"] >= 8


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_none_of_many_faults_is_taken_in_silence(commands, tmp_path, name):
    verdicts, bad = _verdicts(commands[name], tmp_path, KINDS, most=6)
    print(name, dict(verdicts), flush=True)
    assert not bad, bad[:3]
    assert verdicts.total() >= 30
