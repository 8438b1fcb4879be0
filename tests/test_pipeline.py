"""The whole of it, small: videos in, trained policy, evaluation and report out."""

import contextlib
import io
import json
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import urllib.request

import numpy as np
import pytest

from gril_jax.cli import main
from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.demos.demo_set import load_demo_set, select_objects
from gril_jax.errors import DemoError, RunError
from gril_jax.report import rates
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.progress import Progress
from gril_jax.workflows import evaluate
from gril_jax.workflows.build import demonstrations, setup

SMALL = (
    *("--demos.num", "6", "--demos.num-validation", "2", "--demos.num-failures", "2"),
    *("--pretrain.steps", "20", "--pretrain.num-videos", "4"),
    *("--encoder.width", "16", "--encoder.latent", "8", "--env.episode-length", "90"),
    *("--ppo.num-envs", "16", "--ppo.unroll-length", "5", "--ppo.num-timesteps", "160"),
    *("--ppo.hidden", "16", "--run.updates-per-chunk", "1", "--run.eval-episodes", "4"),
    *("--pretrain.num-perturbations", "1", "--pretrain.adversarial-steps", "0"),
    *("--encoder.rounds", "1", "--run.audit", "4"),
    *("--run.evaluations", "0"),  # in a program of their own they are tested by test_training
)


@contextlib.contextmanager
def no_network():
    """Every attempt to reach another host fails, and is in the list that this yields; sockets of
    the machine's own files still work."""
    attempts = []

    def refused(*args, **kwargs):
        attempts.append(args)
        raise OSError(101, "Network is unreachable")

    class Cut(socket.socket):
        def connect(self, address):
            return super().connect(address) if self._is_local() else refused(address)

        def connect_ex(self, address):
            return super().connect_ex(address) if self._is_local() else refused(address)

        def sendto(self, *args):
            return super().sendto(*args) if self._is_local() else refused(*args)

        def _is_local(self):
            return self.family == socket.AF_UNIX

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket, "socket", Cut)
        for name in ("getaddrinfo", "gethostbyname", "gethostbyname_ex", "create_connection"):
            patch.setattr(socket, name, refused)
        yield attempts


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> pathlib.Path:
    """Made without a network: nothing is downloaded or reported."""
    out = tmp_path_factory.mktemp("pipeline") / "run"
    said = io.StringIO()
    with contextlib.redirect_stdout(said), no_network() as attempts:
        assert main.main(["quickstart", "--out", str(out), *SMALL]) == 0
    assert attempts == []
    (out.parent / "said.txt").write_text(said.getvalue())
    return out


def test_it_says_how_many_starts_each_success_rate_counts(run):
    lines = (run.parent / "said.txt").read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("success"))
    assert lines[first : first + 4] == rates.sentences(run_dir.read_results(run))
    for line in lines[first : first + 4]:
        assert re.search(r"% of 4 Layout starts \(95% interval", line)
    assert re.match(r"audit: (passes|fails) \(order 0\.\d+", lines[first + 4])
    assert lines[first + 5].startswith(
        "assistance: task starts only: training episodes begin at the task's Lay"
    )


def test_an_attempt_to_reach_another_host_would_be_noticed():
    with no_network() as attempts:
        for reach in (
            lambda: urllib.request.urlopen("http://example.org"),
            lambda: socket.socket().connect(("127.0.0.1", 9)),
            lambda: socket.getaddrinfo("example.org", 80),
        ):
            with pytest.raises(OSError, match="unreachable"):
                reach()
    assert len(attempts) == 3


CUT_OFF = ["unshare", "--map-root-user", "--net"]


@pytest.mark.slow  # the same in a process of its own, whose kernel gives it no network
def test_a_policy_is_trained_and_exported_where_the_machine_has_no_network(tmp_path):
    if shutil.which("unshare") is None or subprocess.run([*CUT_OFF, "true"]).returncode:
        pytest.skip("a process without network needs unshare and the right to use it")
    gril = [*CUT_OFF, sys.executable, "-m", "gril_jax.cli.main"]
    out = tmp_path / "run"
    for verb in (
        ["quickstart", "--out", str(out), *SMALL],
        ["export", "--what", "policy", str(out), "--out", str(tmp_path / "policy.npz")],
        ["export", str(out), "--out", str(tmp_path / "reward.npz")],
    ):
        done = subprocess.run([*gril, *verb], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_a_run_leaves_everything_a_reader_looks_for(run):
    names = {path.name for path in run.iterdir()}
    assert {
        *("config.yaml", "versions.json", "metrics.jsonl", "results.json", "report.html"),
        *("demos", "reward", "policy", "profiles.npz", "rollouts.npz", "rollout.mp4"),
    } <= names


def test_the_policy_has_stepped_and_the_reward_is_scaled(run):
    rows = run_dir.read_metrics(run)
    assert [r["env_steps"] for r in rows if r["phase"] == "ppo"] == [80, 160]
    with np.load(run / "profiles.npz") as profiles:
        train = profiles["split"] == "train"
        assert profiles["reward"].max() <= 0
        assert profiles["reward"][train, 0].mean() == pytest.approx(-1, abs=0.05)
        assert set(profiles["split"]) == {"train", "validation", "failure"}


@pytest.mark.parametrize(
    ("path", "wanted", "held"),
    [(None, 4, (4, 4)), (None, 1, (7, 1)), ("own", 4, (6, 2)), ("own", 1, (7, 1))],
)
def test_as_many_are_kept_aside_as_asked_but_of_ones_own_a_quarter(run, path, wanted, held):
    """Of the eight successes that the run has made."""
    flags = ["--demos.num-validation", str(wanted), "--pretrain.num-videos", "2"]
    flags += ["--demos.path", str(run / "demos")] * (path is not None)
    config = load("quickstart", flags, prog="test")
    env = setup.make_env(config.env, training=False)
    with Progress() as progress:
        found = demonstrations.gather(config, env, run / "demos", progress)
    assert (len(found.names["train"]), len(found.names["validation"])) == held


def test_failures_are_kept_from_the_encoder(run):
    config = run_dir.read_config(run)
    env = setup.make_env(config.env, training=False)
    config = load(None, ["--demos.path", str(run / "demos"), *SMALL[6:]], prog="test")
    with Progress() as progress, pytest.raises(DemoError, match="the task also has"):
        demonstrations.gather(  # the default task has more blocks than these videos show
            config, setup.make_env(config.env, training=False), run, progress
        )
    found = demonstrations.gather(
        load("quickstart", ["--demos.path", str(run / "demos"), *SMALL], prog=""),
        env,
        run,
        Progress(),
    )
    assert len(found.names["failure"]) == 2
    assert not set(found.names["failure"]) & {*found.names["train"], *found.names["validation"]}


def test_evaluation_and_report_work_from_a_copy_of_the_folder_alone(run, tmp_path):
    copy = tmp_path / "elsewhere"
    shutil.copytree(run, copy)
    (copy / "report.html").unlink()
    said = []
    numbers = evaluate.main(copy, episodes=2, seed=3, echo=said.append)
    assert 0 <= numbers["success"] <= numbers["success_ever"] <= 1
    assert [line.split(":")[0] for line in said[:3]] == [
        "success with deterministic actions", "success with sampled actions",
        "success at some time",
    ]  # fmt: skip
    assert all("of 2 Layout starts" in line for line in said[:3])
    assert any(f"videos do: {numbers['ends_as_videos']:.1%} of these" in line for line in said)
    assert main.main(["report", str(copy)]) == 0
    assert (copy / "report.html").stat().st_size > 100_000
    (copy / "demos" / "demos.json").write_text("{}")
    again = evaluate.main(copy, episodes=2, seed=3, echo=said.append)
    assert again == {name: x for name, x in numbers.items() if name != "ends_as_videos"}
    assert "how many end as its videos do is not known: " in said[-1]


def test_a_run_without_policy_is_refused_in_one_sentence(run, tmp_path):
    copy = tmp_path / "half"
    shutil.copytree(run, copy)
    shutil.rmtree(copy / "policy")
    with pytest.raises(RunError, match=r"manifest\.json is missing, but the run had written it"):
        evaluate.main(copy, episodes=2)


def test_the_reward_can_be_taken_home_from_the_folder(run):
    config = run_dir.read_config(run)
    blank = setup.blank_reward(config, 18)
    params = checkpoint.restore(checkpoint.latest(run / "reward"), blank)
    assert float(params.scale) > 0
    assert params.goal.shape == (8,)


def test_selecting_objects_drops_the_others_and_says_what_is_missing(run):
    demo_set = load_demo_set(run / "demos")
    fewer = select_objects(demo_set, ("goal", "robot", "green square"))
    assert all(fewer.objects(entry) == ["goal", "robot", "green square"] for entry in fewer)
    assert all(entry.tracks.center.shape[1] == 3 for entry in fewer)
    assert all(len(entry.frames) == len(entry) for entry in fewer)
    with pytest.raises(DemoError, match="red star"):
        select_objects(demo_set, ("goal", "red star"))


def test_results_are_plain_numbers(run):
    results = json.loads((run / "results.json").read_text())
    assert results["demonstrations"] == {"train": 6, "validation": 2, "failure": 2}
    assert 0 <= results["success"] <= 1
    assert results["success_random"] == 0
    assert (results["starts"], results["variant"]) == (4, "layout")
    assert "elsewhere_starts" not in results
    assert "demo_solved" not in results
    assert 0 <= results["success_sampled"] <= 1
    assert isinstance(run_dir.read_config(run), RunConfig)
