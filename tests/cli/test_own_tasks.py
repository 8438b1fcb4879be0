"""A task of one's own on the command line: from its file to a policy, and every mistake."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from gril_jax.envs.user_tasks import files
from support import own_task, task_mistakes
from support.paths import REPOSITORY

from gril_jax.cli import main
from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.vision.video import read_video
from gril_jax.export.reward_file import load_reward
from gril_jax.runs import reading, run_dir
from gril_jax.workflows.build import demonstrations
from gril_jax.workflows.study.recipe import changed


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the task and its videos, and a user who has named nothing yet."""
    monkeypatch.setattr(files, "_named", {})
    monkeypatch.setattr(files, "_moved", {})
    return own_task.home(tmp_path, monkeypatch)


def _fault(capsys, *args):
    """The one sentence of a command that is refused; it leaves no folder behind."""
    capsys.readouterr()
    assert main.main(args) == 2
    err = capsys.readouterr().err
    (sentence,) = [line for line in err.splitlines() if line.startswith("gril: ")]
    assert "Traceback" not in err
    return sentence


TRAIN = ("train", "small.yaml", "--task", "my_task.py:make", "--demos", "mine", "--out", "run")


EXAMPLES = REPOSITORY / "experiments" / "examples"


@pytest.fixture
def foreign(folder):
    """A folder out of the repository with the example's task, and videos that its script makes."""
    for file in (EXAMPLES / "my_task").iterdir():
        if file.suffix in (".py", ".yaml"):
            shutil.copy(file, folder)
    shutil.rmtree("mine")
    done = subprocess.run([sys.executable, "make_films.py", "5"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "5 of 5 videos end on the mat\n"
    return folder


def test_every_verb_works_on_a_task_of_ones_own(foreign, capsys, monkeypatch):
    folder = foreign
    assert main.main(TRAIN) == 0
    config = run_dir.read_config(folder / "run")
    assert config.env.name == f"{folder / 'my_task.py'}:make"
    assert reading.task_digest(folder / "run") == files.digest(config.env.name)
    assert (folder / "run" / "rollout.mp4").stat().st_size > 0
    assert "Task my_task" in (folder / "run" / "report.html").read_text()
    assert main.main(["export", "--what", "policy", "run", "--out", "policy.npz"]) == 0
    assert main.main(["export", "run", "--out", "reward.npz"]) == 0
    learned = load_reward("reward.npz")
    assert (learned.classes, learned.robots) == (own_task.CLASSES, ("hand",))
    # Somebody else's run: its task is not run before the user names it.
    monkeypatch.setattr(files, "_named", {})
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "another user"))
    assert "was never named on a command line as it is now" in _fault(capsys, "eval", "run")
    assert main.main(["report", "run"]) == 0  # which runs nothing
    (folder / "my_task.py").rename(folder / "moved.py")
    assert "my_task.py does not exist: if it lies elsewhere" in _fault(capsys, "eval", "run")
    moved = ["--task", "moved.py:make"]
    capsys.readouterr()
    assert main.main(["eval", "run", "--episodes", "2", "--film", *moved]) == 0
    assert "video: run/eval.mp4 (the worst, the median and the best" in capsys.readouterr().out
    assert read_video(folder / "run" / "eval.mp4").shape[2] == 3 * 384
    with open("moved.py", "a") as file:
        file.write("# more\n")
    said = _fault(capsys, "export", "run", "--out", "other.npz", *moved)
    assert "moved.py has been changed since the run began" in said


@pytest.mark.parametrize("slow", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_run_that_was_cut_off_finds_its_task_again(folder, capsys, slow):
    given = ["--env.options", "speed=2", "--demos", "mine", "--out", "run"]
    task = files.name("my_task.py:make")
    config = load("small.yaml", [f"--env.name={task}", *given[:2], "--demos.path", "mine"])
    run_dir.create(folder / "run", config, device="cpu", experiment="pretrain").close()
    text = own_task.TASK
    (folder / "my_task.py").write_text(text + "# more\n")
    assert "has been changed since the run began" in _fault(capsys, "pretrain", "--resume", "run")
    (folder / "my_task.py").write_text(text)
    work = main._plan(["pretrain", "--resume", "run"])
    if slow:
        assert not work()
        assert (folder / "run" / "results.json").exists()


def test_demonstrations_come_from_the_tasks_expert(folder):
    task = ["--task", "my_task.py:make"]
    assert main.main(["demos", "make", "small.yaml", *task, "--out", "shown"]) == 0
    found = load_demo_set(folder / "shown")
    assert (found.task, found.classes, found.robots) == ("my_task", own_task.CLASSES, ("hand",))
    assert [entry.outcome for entry in found] == ["success"] * 6


MISTAKES = [
    ("gone.py:make", "gone.py does not exist"),
    ("my_task.py:mak", "my_task.py has no mak (did you mean 'make'?)"),
    ("gone.py", "gone.py does not exist"),
    ("two.py", "two.py has the functions make, other, so the task must be named as in two.py:make"),
    ("my_task.py:os.system", "must end with the name of a function"),
    ("my_tsak", "there is no task 'my_tsak': the tasks are match_regions"),
]


@pytest.mark.parametrize(("name", "fault"), MISTAKES)
def test_a_task_that_cannot_be_found_is_refused(folder, capsys, name, fault):
    (folder / "two.py").write_text(f"{own_task.TASK}\ndef other():\n    pass\n")
    assert fault in _fault(capsys, "train", "--task", name, "--demos", "mine", "--out", "run")
    assert not (folder / "run").exists()


def test_a_file_alone_will_do_where_it_has_one_function(folder):
    work = main._plan(["train", "small.yaml", "--task", "my_task.py", "--demos", "mine"])
    assert callable(work)
    (folder / "alone.yaml").write_text("env: {name: my_task.py}\n")
    assert load("alone.yaml").env.name == f"{folder / 'my_task.py'}"


def test_videos_of_ones_own_need_a_task_to_train_a_policy(folder, capsys):
    said = _fault(capsys, "train", "--demos", "mine", "--out", "run")
    assert "gril train needs --task, the simulation in which a policy learns what mine" in said
    assert "such as --task my_task.py:make; gril pretrain learns the reward alone" in said
    assert not (folder / "run").exists()


def test_a_reward_without_a_set_says_whose_demonstrations_it_takes():
    config = changed(RunConfig(), {"demos.num": 9})
    said = "no --demos is given, so 9 scripted demonstrations of match_regions are made first"
    assert demonstrations.announced(config) == said
    assert demonstrations.announced(changed(config, {"demos.path": "mine"})) is None


CHANGES = [
    (("return Task()", "raise OSError('gone')"), "make failed at line 25: OSError: gone"),
    (('"hand", "puck")', '"hand", "disc")'), "its classes are hand, mat, puck, but those of"),
    (("== 1)", "== 2)"), "the robot is hand there, but puck in my_task"),
    (("puck - 0.1, puck])", "puck - 0.1])"), "objects.size has the shape"),
    (("jnp.clip(state.data", "puck if action[0] > 0 else (state.data"), "step fails as JAX"),
    (("center = jnp", "puck = puck * jnp.nan\n        center = jnp"), "NaN or infinity in"),
    (("episode_length = 2, 8", "episode_length, half_extent = 2, 8, 2.0"), "in the same unit"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "fault"), CHANGES)
def test_a_task_that_is_not_as_it_must_be_is_refused_before_work(folder, capsys, change, fault):
    own_task.write(folder, change=change)
    task = ("--task", "my_task.py:make", "--demos", "mine", "--out", "run")
    assert fault in _fault(capsys, "train", "small.yaml", *task)
    assert not (folder / "run").exists()


def test_a_task_without_films_and_expert_says_where_films_come_from(folder, capsys):
    own_task.write(folder, change=("    def expert", "    def no_expert"))
    fault = _fault(capsys, "train", "--task", "my_task.py:make", "--out", "run")
    assert "my_task has no expert that could demonstrate it, so --demos must name a set" in fault
    assert not (folder / "run").exists()


def test_options_are_checked(folder, capsys):
    task = ("train", "--task", "my_task.py:make", "--demos", "mine")
    assert "has no option 'sped' (did you mean 'speed'?)" in _fault(
        capsys, *task, "--env.options", "sped=2"
    )
    assert "must be a list of NAME=VALUE" in _fault(capsys, *task, "--env.options", "speed")


def test_a_configuration_that_names_a_task_does_not_run_it(folder, capsys):
    shutil.copy("my_task.py", "evil.py")
    with open("evil.py", "a") as file:
        file.write("open('ran', 'w')\n")
    (folder / "given.yaml").write_text("env: {name: 'evil.py:make'}\n")
    said = _fault(capsys, "train", "given.yaml", "--demos", "mine", "--out", "run")
    assert "evil.py was never named on a command line as it is now, so it is not run" in said
    assert not (folder / "ran").exists()


def test_a_new_task_keeps_the_contract(folder, capsys):
    assert main.main(["new-task", "kick"]) == 0
    assert main.main(["check-task", "kick.py:make", "--options", "speed=0.1"]) == 0
    out = capsys.readouterr().out
    assert "MISSING" not in out
    assert "kick: classes region, robot, block; 2 actions, 8 observations" in out
    assert "kick.py exists already" in _fault(capsys, "new-task", "kick")
    assert "must be a name such as push_puck" in _fault(capsys, "new-task", "../kick")


@pytest.mark.parametrize("name", ["push-puck", "1puck", "class", "../puck", "", "pück"])
def test_a_new_task_needs_a_name_that_python_takes(folder, capsys, name):
    before = sorted(Path.cwd().iterdir())
    assert main.main(["new-task", name]) == 2
    error = capsys.readouterr().err
    assert "must be a name such as push_puck" in error or "is empty" in error
    assert error.count("\n") == 1
    assert sorted(Path.cwd().iterdir()) == before


def test_check_task_fails_where_something_is_missing(folder, capsys):
    own_task.write(folder, change=("(jnp.abs(puck) < 0.3).all()", "jnp.abs(puck).max()"))
    assert main.main(["check-task", "my_task.py:make"]) == 1
    assert "MISSING   success has" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "stem"), [("my_task", "my_task"), ("gymnax_task", "herd"), ("mjx_task", "slide")]
)
def test_a_foreign_project_is_learned_from_its_films_alone(folder, name, stem):
    """In an empty folder, with the installed command and no edit of ours, within ten minutes."""
    for file in (EXAMPLES / name).glob("*.*"):
        shutil.copy(file, folder)
    task = folder / f"{stem}.py"
    command, make = [sys.executable, "-m", "gril_jax.cli.main"], f"{task.name}:make"
    if name == "my_task":
        shutil.rmtree("mine")
        subprocess.run([sys.executable, "make_films.py"], check=True)
        films = ["--demos", "mine"]
    else:
        films = []
    config = ["train", task.with_suffix(".yaml").name, "--task", make, *films, "--out", "run"]
    done = subprocess.run(command + config, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rate = re.search(r"deterministic actions: ([\d.]+)% of 256 starts", done.stdout)
    assert float(rate[1]) >= 90


_ALL = task_mistakes.MISTAKES | task_mistakes.KEPT_ASIDE


@pytest.mark.parametrize("kind", _ALL)
def test_a_mistake_in_a_task_is_one_sentence(tmp_path, capfd, kind):
    *change, words = _ALL[kind]
    path = own_task.write(tmp_path, change=change)
    code = main.main(["check-task", f"{path}:make"])
    out, err = capfd.readouterr()
    assert code in (1, 2)
    assert "Traceback" not in out + err
    wrong = [line for line in (out + err).splitlines() if "MISSING" in line or "gril: " in line]
    assert any(words in line for line in wrong)
