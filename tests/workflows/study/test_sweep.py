"""`gril sweep`: what reaches the driver, and what is refused before work starts."""

import json

import pytest

from gril_jax.cli import main
from gril_jax.cli.devices import slots
from gril_jax.cli.verbs import sweep
from gril_jax.config.files import load
from gril_jax.errors import ConfigError
from gril_jax.workflows.study import recipe
from gril_jax.workflows.study.recipe import changed


@pytest.fixture
def planned(monkeypatch):
    """The plans that command lines come to, whose work is not done."""
    plans = []
    monkeypatch.setattr(
        sweep, "_made", lambda plan, *args, **more: plans.append(plan) or (lambda: 0)
    )

    def of(*args):
        assert main.main(["sweep", *args]) == 0
        return plans[-1]

    return of


def _fault(capsys, *args, code=2):
    assert main.main(["sweep", *map(str, args)]) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


def test_a_study_has_the_rows_and_options_of_its_file(planned):
    plan, made = planned("table1"), recipe.load("table1")
    base = changed(load("match_regions"), {"run.evaluations": 10})
    assert plan.config == base
    assert plan.rows == {row: changed(base, change) for row, change in made.rows.items()}
    assert plan.work == dict.fromkeys(made.rows, range(5))


def test_options_count_for_all_rows_whatever_these_say(planned):
    plan = planned(
        "table1", "--rows", "sparse score,XIRL", "--seeds", "3", "--run.evaluations", "4",
        "--pretrain.steps", "7", "--lambda=0.5", "--ascents", "9",
    )  # fmt: skip
    assert plan.work == dict.fromkeys(("XIRL", "sparse score"), range(3))
    assert plan.config.run.evaluations == 4
    for row in plan.rows.values():
        assert (row.pretrain.steps, row.loss.lambda_) == (7, 0.5)
    assert plan.study.measure["audit"]["ascents"] == 9
    assert plan.rows["XIRL"].encoder.kind == "pixels"


def test_a_dry_run_tells_each_row_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = ("--rows", "ours,TCC*", "--seeds", "2", "--ppo.num-timesteps", "40960")
    assert main.main(["sweep", "rewards", *options, "--dry-run"]) == 0
    said = capsys.readouterr().out.splitlines()
    each = "a reward, 3,500 gradient steps; a policy of match_regions, 40,960 env steps; 2 seeds"
    assert said[:2] == [f"ours: {each}", f"TCC alone: {each}"]
    assert said[2].startswith("in all 4 rewards, 4 policies, 1 program, 163,840 env steps, on ")
    assert not [*tmp_path.iterdir()]
    assert "leave out --devices" in _fault(capsys, "rewards", "--dry-run", "--devices", 2)


def test_a_dry_run_makes_no_demonstration_sets(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    suite = "suite", "--dry-run", "--rows", "find_dupe from videos"
    assert "to make it of videos --videos is missing" in _fault(capsys, *suite, code=1)
    (tmp_path / "films" / "find-dupe").mkdir(parents=True)
    (tmp_path / "films" / "find-dupe" / "000.mp4").touch()
    said = "runs/magical_sets/find_dupe would be made first, but a dry run makes no"
    assert said in _fault(capsys, *suite, "--videos", "films", code=1)
    assert not (tmp_path / "runs").exists()


def test_the_smaller_version_has_a_base_rows_and_seeds_of_its_own(planned):
    plan = planned("table1", "--quick", "--algorithm", "sac")
    assert plan.work == dict.fromkeys(("environmental", "ours without robot"), range(2))
    assert plan.rows["ours without robot"].pretrain.steps == 1500
    assert (plan.config.run.algorithm, plan.config.ppo) == ("sac", load("quickstart").ppo)
    plan = planned("table2", "--quick", "--demos.num", "30")
    assert (plan.config.demos.num, plan.config.demos.num_failures) == (30, 50)
    for row in plan.rows.values():
        assert (row.demos.num, row.demos.num_failures, row.pretrain.steps) == (30, 21, 1200)
    assert not plan.study.policies


def test_axes_cross_the_rows_of_a_study(planned):
    rates = "1e-3,2e-3"
    plan = planned("table1", "--rows", "environmental,ours*robot", "--ppo.learning-rate", rates)
    assert [*plan.work] == [
        f"{row}, learning-rate {rate}"
        for row in ("environmental", "ours with robot", "ours without robot")
        for rate in rates.split(",")
    ]
    one = plan.rows["ours with robot, learning-rate 2e-3"]
    assert (one.ppo.learning_rate, one.encoder.robot) == (2e-3, True)


def test_sets_are_those_of_the_rows_tasks(planned, tmp_path):
    plan = planned("table3", "--rows", "ours on umbrella_out", "--sets", "mine")
    assert plan.rows["ours on umbrella_out"].demos.path == "mine/umbrella_out"
    assert planned("table3").rows["ours on umbrella_out"].demos.path is None
    plan = planned("suite", "--seeds", "1", "--eval-starts", "4", "--ppo.num-timesteps", "6000000")
    assert plan.rows["find_dupe from videos"].demos.path == "runs/magical_sets/find_dupe"
    assert plan.rows["make_line from videos in all"].ppo.num_timesteps == 6_000_000
    assert len(plan.work) == 24


def test_a_file_of_one_s_own_is_a_study_and_rows_alike_are_made_once(planned, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("base: quickstart\nrows: {a: {pool.alpha: 2}, b: {pool.alpha: 2.0}, c: }\n")
    plan = planned(str(file), "--seeds", "1", "--rewards-only")
    assert ([*plan.work], plan.study.name, plan.study.policies) == (["a", "c"], "mine", False)


def test_mistakes_are_one_sentence(capsys, tmp_path):
    for option in ("--seeds", "--ascents", "--starts"):
        err = _fault(capsys, "table1", option, "0")
        assert f"{option} is 0, but must be" in err
    for args, said in (
        (["table1", "--rows", "enviromental"], "(did you mean environmental?)"),
        (["table2", "--ascents", "3"], "the study does not measure audit"),
        (["ladder", "--algorithm", "sac"], "must be 'ppo', because the row"),
        (["tabel1"], "there is no configuration 'tabel1'"),
        (["table1", "--cluster", "sge"], "--cluster is 'sge', but must be one of"),
        (["--resume", tmp_path], "has no config.yaml"),
        (["--resume", tmp_path, "--demos", "x"], "--demos must not be given beside it"),
        (["--distributed", "--devices", "2"], "--distributed finds no job"),
    ):
        assert said in _fault(capsys, *args)


def test_unfit_demonstrations_and_missing_films_are_refused_before_work_starts(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    header = {"task": "shoes_in_box", "demos": []}
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "demos.json").write_text(json.dumps(header))
    for args, said in (
        (["table1", "--demos", "other"], "other"),
        (["suite", "--rows", "find_dupe from videos"], "--videos is missing"),
        (["suite", "--videos", "other"], "has no folder"),
        (["quickstart", "--reward", "a/b.npz"], "a/b.npz"),
        (["quickstart", "--reward", "environmental", "--ppo.num-envs", "3",
          "--ppo.num-minibatches", "1"], "ppo.num_envs is 3, but must be even"),
    ):  # fmt: skip
        assert main.main(["sweep", *args]) != 0
        assert said in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"other"}


def test_the_devices_are_all_gpus_or_the_first(monkeypatch):
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,5,7")
    assert slots(None) == slots("all") == ["4", "5", "7"]
    assert slots("2") == ["4", "5"]
    with pytest.raises(ConfigError, match="this machine has 3 GPUs"):
        slots("4")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4")
    assert slots(None) == [None]  # one process, as it is
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert slots(None) == [None]
    assert slots("2") == [None, None]
    with pytest.raises(ConfigError, match="must be all or a number"):
        slots("two")
