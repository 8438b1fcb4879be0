"""Checks, calls and results of each verb, in this process and with stand-ins for the work."""

import dataclasses
import sys
import types
from inspect import signature
from pathlib import Path

import pytest

from gril_jax.cli import arguments, main, verbs
from gril_jax.cli.verbs import machine
from gril_jax.config import MakeDemosConfig, RunConfig, RunSettings
from gril_jax.config.files import load
from gril_jax.demos import importing
from gril_jax.demos.demo_set import DemoSet
from gril_jax.errors import DemoError, RunError
from gril_jax.runs import run_dir
from gril_jax.workflows import import_videos as workflow

_PIPELINE = "gril_jax.workflows.build"


@pytest.fixture
def demo_set(tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    (folder / "demos.json").write_text("{}")
    return folder


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run"
    run_dir.create(path, RunConfig(), device="cpu").close()
    return path


@pytest.fixture
def trained(run):
    """A run with what a policy's checkpoint is known by."""
    (run / "policy" / "000000000640").mkdir(parents=True)
    (run / "policy" / "000000000640" / "manifest.json").write_text("{}")
    return run


@pytest.fixture
def experiment(monkeypatch):
    """Puts a stand-in for an experiment in place and returns the calls to its `main`."""
    calls = []

    def stand_in(name, package="gril_jax.workflows", **functions):
        module = types.ModuleType(f"{package}.{name}")
        record = lambda *args, **kwargs: calls.append((args, kwargs))  # noqa: E731
        for function, body in (functions or {"main": record}).items():
            setattr(module, function, body)
        monkeypatch.setitem(sys.modules, f"{package}.{name}", module)
        monkeypatch.setattr(f"{package}.{name}", module, raising=False)
        return calls

    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    return stand_in


# --- paths, in this process


def _fault(capsys, *args):
    assert main.main(args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    return err


def test_a_folder_without_a_demo_set_is_refused(tmp_path, capsys):
    err = _fault(capsys, "quickstart", "--demos", str(tmp_path))
    assert "is not a demonstration set, because it has no demos.json" in err


def test_an_output_folder_that_exists_or_cannot_be_is_refused(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert "exists already" in _fault(capsys, "train", "--out", str(tmp_path))
    below = str(tmp_path / "file" / "run")
    assert "cannot be created, because" in _fault(capsys, "train", "--out", below)


def test_demonstrations_do_not_replace_a_folder_of_other_files(tmp_path, capsys):
    (tmp_path / "thesis.tex").touch()
    err = _fault(capsys, "demos", "make", "--out", str(tmp_path))
    assert "holds other files" in err


@pytest.mark.parametrize("half_extent", ["0", "-1", "nan", "inf"])
def test_a_frame_shows_some_of_the_world(tmp_path, capsys, half_extent):
    args = ("--out", str(tmp_path / "out"), f"--half-extent={half_extent}")
    err = _fault(capsys, "demos", "import-videos", str(tmp_path), *args)
    assert "but must be finite and above 0" in err


@pytest.mark.parametrize("option", ["--episodes=0", "--seed=-1", f"--seed={2**31}"])
def test_numbers_of_an_evaluation_have_ranges(run, capsys, option):
    assert f"{option.split('=')[0]} is " in _fault(capsys, "eval", str(run), option)


@pytest.mark.parametrize("leftover", [None, "000000000640", ".000000000640.part"])
def test_a_run_without_a_whole_policy_has_none_to_export(run, tmp_path, capsys, leftover):
    if leftover is not None:
        (run / "policy" / leftover).mkdir(parents=True)
    if leftover == ".000000000640.part":
        (run / "policy" / leftover / "manifest.json").touch()
    err = _fault(capsys, "export", str(run), "--what", "policy", "--out", "x.npz")
    assert "has no policy, so its run has not got that far yet" in err


def test_a_run_that_learns_no_reward_is_told_so(tmp_path, capsys):
    config = RunConfig(run=RunSettings(reward="environmental"))
    run_dir.create(tmp_path / "run", config, device="cpu").close()
    for verb in (["audit"], ["subtasks"], ["export", "--out", "x.npz"]):
        err = _fault(capsys, verb[0], str(tmp_path / "run"), *verb[1:])
        assert "has no learned reward: its policy was trained on run.reward 'environmental'" in err


@pytest.mark.parametrize(
    ("out", "fault"),
    [
        ("taken.npz", "taken.npz exists already, but --out must be a new file"),
        ("dangling", "dangling exists already, but --out must be a new file"),
        ("run", "run exists already, but --out must be a new file"),
        ("gone/policy.npz", "gone does not exist, but --out must be in a folder that exists"),
        ("taken.npz/x.npz", "taken.npz is a file, but --out must be in a folder that exists"),
        ("x" * 300, "cannot be written to (File name too long)"),
    ],
)
def test_a_policy_is_exported_to_a_new_file_of_a_folder(trained, tmp_path, capsys, out, fault):
    (tmp_path / "taken.npz").write_text("precious")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    err = _fault(capsys, "export", str(trained), "--what", "policy", "--out", str(tmp_path / out))
    assert fault in err
    assert (tmp_path / "taken.npz").read_text() == "precious"


# --- what a verb calls


@pytest.mark.parametrize(
    ("args", "name", "overrides"),
    [
        (["quickstart", "--seed=3"], "quickstart", ["--run.seed", "3"]),
        (["train"], None, []),
        (["train", "match_regions", "--lambda", "2"], "match_regions", ["--loss.lambda=2"]),
        (["train", "--ppo.num-envs", "32", "quickstart"], "quickstart", ["--ppo.num-envs=32"]),
        (["pretrain", "quickstart", "--out", "new"], "quickstart", ["--run.out=new"]),
    ],
)
def test_a_run_has_its_configuration_and_above_it_the_options(
    experiment, tmp_path, monkeypatch, args, name, overrides
):
    monkeypatch.chdir(tmp_path)
    calls = experiment("pretrain" if args[0] == "pretrain" else "train")
    assert main.main(args) == 0
    assert calls == [((load(name, overrides),), {"echo": arguments.echo})]


def test_the_results_of_an_experiment_are_no_exit_code(experiment):
    experiment("train", main=lambda *_, **__: {"success": 0.9})
    assert main.main(["train"]) == 0


def test_demos_make_hands_on_the_folder(experiment, tmp_path):
    calls = experiment("make_demos", _PIPELINE)
    out = tmp_path / "set"
    args = ["--num", "9", "--num-failures=5", "--variant", "jitter", "--seed", "3"]
    blocks = ["--env.targets", "red star"]
    assert main.main(["demos", "make", "quickstart", f"--out={out}", *args, *blocks]) == 2
    args[4] = "layout"
    assert main.main(["demos", "make", "quickstart", f"--out={out}", *args, *blocks]) == 0
    under = load("quickstart")
    config = MakeDemosConfig(
        dataclasses.replace(under.env, targets=("red star",)),
        dataclasses.replace(under.demos, num=9, num_failures=5),
    )
    starts = {"variant": "layout", "seed": 3}
    assert calls == [((config, out), {"echo": arguments.echo} | starts)]


def test_a_demo_set_may_be_replaced(experiment, demo_set):
    calls = experiment("make_demos", _PIPELINE)
    assert main.main(["demos", "make", "--out", str(demo_set)]) == 0
    assert calls[0][0][1] == demo_set


def test_eval_hands_on_its_options(experiment, run):
    calls = experiment("evaluate")
    assert main.main(["eval", str(run), "--episodes=7", "--variant", "layout"]) == 0
    wanted = {
        "episodes": 7, "seed": 0, "variant": "layout", "engine": None, "film": False,
        "echo": arguments.echo,
    }  # fmt: skip
    assert calls == [((run,), wanted)]


def test_report_hands_on_the_run(experiment, run):
    calls = experiment("report")
    assert main.main(["report", str(run)]) == 0
    assert calls == [((run,), {"demos": None, "echo": arguments.echo})]


def test_report_draws_the_page_of_a_study_anew(experiment, tmp_path, monkeypatch):
    from gril_jax.workflows.study import summary

    calls = []
    monkeypatch.setattr(summary, "redraw", lambda *args: calls.append(args))
    path = tmp_path / "run"
    run_dir.create(path, RunConfig(), device="cpu", experiment="sweep").close()
    assert main.main(["report", str(path)]) == 0
    assert calls == [(path, arguments.echo)]


def test_export_of_a_policy_builds_the_run_s_own_algorithm(experiment, trained, tmp_path):
    experiment("setup", _PIPELINE, make_env=lambda config, training: ("env", config, training))
    experiment(
        "policy_setup",
        _PIPELINE,
        make_algorithm=lambda config, env: ("ppo", config, env),
        restore_policy=lambda folder, config, algorithm: ("policy", folder),
    )
    calls = []
    experiment("policy_file", "gril_jax.export", save=lambda *given: calls.append(given))
    out = tmp_path / "policy.npz"
    assert main.main(["export", str(trained), "--what=policy", f"--out={out}"]) == 0
    config = RunConfig()
    algorithm = ("ppo", config, ("env", config.env, False))
    assert calls == [(out, config, algorithm, ("policy", trained))]


def test_export_of_a_reward_hands_on_run_and_file(experiment, run, tmp_path, capsys):
    calls = experiment("export_reward")
    out = tmp_path / "reward.npz"
    assert main.main(["export", str(run), f"--out={out}"]) == 2
    assert f"{run} has no reward" in capsys.readouterr().err
    (run / "reward" / "000000000100").mkdir(parents=True)
    (run / "reward" / "000000000100" / "manifest.json").write_text("{}")
    assert main.main(["export", str(run), f"--out={out}"]) == 0
    assert calls == [((run, out), {"echo": arguments.echo})]


def test_imports_hand_on_their_folders_and_tell_their_progress(
    monkeypatch, tmp_path, capsys, demo_set
):
    calls = []

    def importer(*args, progress, **kwargs):
        progress(1, 2)
        calls.append((args, kwargs))
        return DemoSet((), "", (), 1.0, 1.0, "")

    monkeypatch.setattr(workflow, "import_videos", importer)
    out = tmp_path / "out"
    assert main.main(["demos", "import-videos", str(tmp_path), "--out", str(out)]) == 0
    args = ["demos", "import-videos", str(tmp_path), "--out", str(out)]
    assert main.main([*args, "--task", "match_regions_magical"]) == 0
    assert main.main([*args, "--task", "match_regons"]) == 2
    capsys.readouterr()
    args = ["demos", "import-videos", str(tmp_path), "--out", str(out), "--half-extent", "1.5"]
    assert main.main([*args, "--outcome", "success", "--boxes", "colour"]) == 0
    assert [given for given, _ in calls] == [(tmp_path, out)] * 3
    takes = signature(importing.import_videos)
    for _, options in calls:
        takes.bind("a", "b", **options, progress=None)
    given = [(o["task"], o["boxes"], o.get("half_extent"), o.get("outcome")) for _, o in calls]
    assert given == [
        (None, "auto", None, "unknown"),
        ("match_regions_magical", "auto", None, "unknown"),
        (None, "colour", 1.5, "success"),
    ]
    stdout, stderr = capsys.readouterr()
    assert stdout == f"wrote {out}\n"
    assert "reading: 1/2 videos (50%)" in stderr


# --- failures at work


@pytest.mark.parametrize("error", [RunError("the disk is gone"), DemoError("bad demo.")])
def test_a_failure_at_work_is_one_sentence_and_exit_code_1(experiment, capsys, error):
    def fail(*_, **__):
        raise error

    experiment("train", main=fail)
    assert main.main(["train"]) == 1
    assert capsys.readouterr().err == f"gril: {str(error).rstrip('.')}.\n"


def test_an_interrupt_is_exit_code_130(experiment, capsys):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    experiment("train", main=interrupt)
    assert main.main(["train"]) == 130
    assert capsys.readouterr().err == "gril: interrupted.\n"


def test_our_own_mistakes_keep_their_traceback(experiment):
    def bug(*_, **__):
        raise ZeroDivisionError

    experiment("train", main=bug)
    with pytest.raises(ZeroDivisionError):
        main.main(["train"])


def test_the_doctor_s_verdict_is_the_exit_code(monkeypatch, capsys):
    for needed, code, word in ((True, 1, "BROKEN    "), (False, 0, "no        ")):
        rows = [machine.Check("jax", False, needed, "missing"), machine.Check("a", True, True, "")]
        monkeypatch.setattr(machine, "check_all", lambda timeout_s, rows=rows: rows)
        assert main.main(["doctor"]) == code
        assert capsys.readouterr().out == f"jax  {word}missing\na    ok\n"


# --- a new verb


def test_a_verb_is_one_entry_of_a_module_that_is_listed(tmp_path, monkeypatch, capsys):
    (tmp_path / "manners.py").write_text(
        "from gril_jax.cli.verbs import Verb\n"
        "def plan(args):\n"
        "    return lambda: print('hello', *args)\n"
        "VERBS = {'Manners': (Verb('greet-all NAME', 'says hello', plan),)}\n"
    )
    monkeypatch.setattr(verbs, "__path__", [*verbs.__path__, str(tmp_path)])
    monkeypatch.setattr(verbs, "MODULES", (*verbs.MODULES, "manners"))
    assert main.main(["greet-all", "you"]) == 0
    assert capsys.readouterr().out == "hello you\n"
    assert main.main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert "\nManners:\n  greet-all NAME              says hello\n" in shown
    assert main.main(["greet-al"]) == 2
    assert "(did you mean greet-all?)" in capsys.readouterr().err
    sys.modules.pop("gril_jax.cli.verbs.manners")


def test_every_file_of_verbs_is_listed_and_no_verb_is_twice():
    (folder,) = verbs.__path__
    assert sorted(verbs.MODULES) == sorted(p.stem for p in Path(folder).glob("[!_]*.py"))
    names = [verb.name for verb in verbs.every()]
    assert len(names) == len({*names})
    assert all(verb.usage.startswith(verb.name) for verb in verbs.every())
