"""Videos of one's own, from boxes to a reward elsewhere, on the command line and without a task."""

import json
import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from support import kitchen_films

from gril_jax.audit.thresholds import VIDEOS
from gril_jax.cli import main
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.export.reward_file import load_reward

SMALL = {"fps": 10.0, "width": 64, "height": 48, "tempo": 2.0}
LITTLE = ["--pretrain.steps", "4", "--pretrain.num-perturbations", "0", "--encoder.width", "8"]
LITTLE += ["--encoder.relations", "False"]


def gril(*args):
    return main.main([str(arg) for arg in args])


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Videos, the set that was made of them, and a run that learned a little from it."""
    folder = tmp_path_factory.mktemp("kitchen")
    kitchen_films.write_films(folder / "films", 5, **SMALL)
    films = ("demos", "import-videos", folder / "films", "--boxes", "auto", "--robot", "hand")
    assert gril(*films, "--out", folder / "mine") == 0
    assert gril("pretrain", "--demos", folder / "mine", "--out", folder / "run", *LITTLE) == 0
    return folder


def test_a_set_has_the_classes_the_robot_the_unit_and_the_rate_of_the_films(home):
    mine = load_demo_set(home / "mine")
    assert mine.classes == ("coaster", "cup", "hand", "spoon")
    assert (mine.robots, mine.task) == (("hand",), "")
    assert (mine.unit, mine.half_extent, mine.fps) == ("widths of the picture", 0.5, 10.0)
    batch = demo_batch(mine)
    assert np.asarray(batch.is_robot).tolist() == [[False, False, True, False]] * 5
    told = kitchen_films.story(0, **SMALL)
    cup = told.boxes[:, 0]
    middle = ((cup[:, :2] + cup[:, 2:]) / 2 - [32, 24]) / 64 * [1, -1]
    kept = len(mine[0])
    np.testing.assert_allclose(mine[0].tracks.center[:, 1], middle[:kept], atol=1e-4)
    assert (home / "mine" / "import.png").stat().st_size > 10_000
    assert "5 videos, 10 frames a second" in (home / "mine" / "import.txt").read_text()


def test_a_run_of_films_is_exported_with_their_words_and_loaded(home, capsys):
    assert gril("export", home / "run", "--out", home / "kitchen.npz") == 0
    assert "widths of the picture" in capsys.readouterr().out
    learned = load_reward(home / "kitchen.npz")
    assert learned.objects == learned.classes == ("coaster", "cup", "hand", "spoon")
    assert learned.robots == ("hand",)
    about = learned.about
    assert (about["half_extent"], about["unit"]) == (0.5, "widths of the picture")
    assert about["provenance"]["fps"] == 10.0
    batch = demo_batch(load_demo_set(home / "mine"))
    rewards = learned.trajectory(batch.center[0], batch.size[0])
    profiles = np.load(home / "run" / "profiles.npz")
    length = int(profiles["length"][0])
    np.testing.assert_allclose(rewards[:length], profiles["reward"][0, :length], atol=1e-4)
    assert bool(jnp.isfinite(rewards).all())


def test_a_dry_run_on_films_says_how_long_and_writes_nothing(home, capsys):
    run = ("pretrain", "--demos", home / "mine", "--out", home / "dry", *LITTLE)
    assert gril(*run, "--dry-run") == 0
    said = capsys.readouterr().out
    assert f"demonstrations: 5 of {home / 'mine'}, of coaster, cup, hand, spoon" in said
    assert "reward: 4 gradient steps, about" in said
    assert not (home / "dry").exists()


def test_an_audit_of_films_says_what_it_leaves_out(home, capsys):
    assert gril("audit", home / "run", "--ascents", "20") == 0
    said = capsys.readouterr().out
    assert "left out, because videos do not define success" in said
    assert "s the audit of the videos alone: " in said
    assert "No state was searched" in said
    found = json.loads((home / "run" / "audit" / "audit.json").read_text())
    assert found["audit"] == "audit of the videos alone: no state was searched"
    assert found["scenes"] >= 1
    assert 0 <= found["misranked_share"] <= 1
    for name, one in found["thresholds"].items():
        assert one["direction"] in ("at most", "at least")
        assert found["passes"][name] == VIDEOS[name].holds(found[name])
    assert gril("report", home / "run") == 0
    page = (home / "run" / "report.html").read_text()
    assert "s the audit of the videos alone" in page
    assert "The audit of the reward" in page
    assert "at most 0.02" in page


def test_a_file_of_a_reward_is_audited_with_its_videos(home, tmp_path, capsys):
    reward = tmp_path / "kitchen.npz"
    assert gril("export", home / "run", "--out", reward) == 0
    assert gril("audit", reward) == 2
    assert "or with --demos the videos" in capsys.readouterr().err
    assert gril("audit", home / "run", "--ascents", "20", "--out", tmp_path / "of_run") == 0
    assert gril("audit", reward, "--demos", home / "mine", "--ascents", "20") == 0
    of_run, of_file = (
        json.loads((tmp_path / name / "audit.json").read_text())
        for name in ("of_run", "kitchen-audit")
    )
    along = [x + end for x in ("voc_pearson", "voc_spearman") for end in ("", "_tails")]
    figures = [of_run.pop(name) for name in (*VIDEOS, *along)]
    assert figures == [of_file.pop(name) for name in (*VIDEOS, *along)]
    assert "voc_spearman" in capsys.readouterr().out


def test_a_run_is_found_wherever_it_and_its_videos_are(home, tmp_path, monkeypatch, capsys):
    """Both together, from another directory; the run alone; and videos that only the user finds."""
    together = tmp_path / "together"
    together.mkdir()
    for name in ("mine", "run"):
        shutil.copytree(home / name, together / name)
    monkeypatch.chdir(tmp_path)
    other = shutil.copytree(home / "mine", tmp_path / "else" / "mine")
    header = json.loads((other / "demos.json").read_text())
    (other / "demos.json").write_text(json.dumps(header | {"source": "another"}))
    look = ("--ascents", "5")
    kept = home.rename(home.with_name("gone"))
    try:
        assert gril("audit", "together/run", *look) == 0
        assert gril("report", "together/run") == 0
        assert "shown" not in capsys.readouterr().err
        alone = shutil.move(together / "run", tmp_path / "else" / "run")  # beside another set
        assert gril("audit", alone, *look) != 0
        (said,) = capsys.readouterr().err.splitlines()
        assert "is gone, but the audit makes its scenes" in said
        assert "say where with --demos" in said
        assert gril("audit", alone, *look, "--demos", other) != 0
        assert "has been changed since the run" in capsys.readouterr().err
        assert gril("audit", alone, *look, "--demos", together / "mine") == 0
        assert gril("export", alone, "--out", tmp_path / "kitchen.npz") == 0
    finally:
        kept.rename(home)
    moved = shutil.move(alone, tmp_path / "far" / "run")
    assert gril("audit", moved, *look) == 0  # its videos are where they were


def test_a_policy_and_another_task_are_refused_in_a_sentence(home, capsys):
    assert gril("train", "own_videos", "--demos", home / "mine") == 2
    assert "gril train needs a task:" in capsys.readouterr().err
    assert gril("pretrain", "match_regions_fast", "--demos", home / "mine", "--out", "x") == 2
    assert "its class names are not those of match_regions" in capsys.readouterr().err
    assert gril("pretrain", "own_videos") == 2
    assert "--demos must name a demonstration set" in capsys.readouterr().err
    assert gril("audit", home / "run", "--task", "match_regions") == 2
    assert "was trained on videos alone" in capsys.readouterr().err


def test_lengths_of_another_unit_are_refused_by_a_task(tmp_path, capsys):
    from support.run_folders import save_demos

    save_demos(tmp_path / "set", names=("a", "b", "c", "d"))
    header = json.loads((tmp_path / "set" / "demos.json").read_text())
    for unit, half_extent, code in (("world units", 1.0, 2), ("widths of the picture", 0.5, 2)):
        changed = header | {"unit": unit, "half_extent": half_extent}
        (tmp_path / "set" / "demos.json").write_text(json.dumps(changed))
        options = ("--demos", tmp_path / "set", "--out", tmp_path / "run")
        assert gril("pretrain", "match_regions_fast", *options) == code
        assert f"a frame shows {half_extent:g} {unit} to each side" in capsys.readouterr().err
        assert not (tmp_path / "run").exists()


BAD = {
    "a robot that is never seen": (["--robot", "arm"], None, "class 'arm'; the classes are"),
    "robots alone": (["--robot", "cup", "coaster", "spoon", "hand"], None, "all classes are"),
    "another task's classes": (["--task", "match_regions"], None, "is not one of the task's: goal"),
    "no such task": (["--task", "tidy"], None, "there is no task 'tidy'"),
    "no frame rate": (["--fps", "0"], None, "--fps is 0.0, but must be from"),
    "an even smoothing": (["--smoothing", "4"], None, "--smoothing is 4, but must be odd"),
    "boxes of another size": (
        [], lambda text: text.replace(",", ",9", 9_999), "of a video of another size"
    ),
    "a video without boxes": ([], None, "no boxes are beside the video"),
    "a video of one frame": ([], None, "holds 1 frame, but a demonstration needs at least 2"),
    "a video that is cut short": ([], None, "kitchen_00.mp4: "),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_wrong_films_and_options_are_one_sentence_and_leave_nothing(home, tmp_path, capsys, kind):
    options, change, words = BAD[kind]
    films = shutil.copytree(home / "films", tmp_path / "films")
    boxes, film = films / "kitchen_00.csv", films / "kitchen_00.mp4"
    if change:
        head, rows = boxes.read_text().split("\n", 1)
        cells = (row.split(",") for row in rows.splitlines())
        moved = (",".join([*x[:2], *(f"9{edge}" for edge in x[2:6]), *x[6:]]) for x in cells)
        boxes.write_text("\n".join([head, *moved]))
    if kind == "a video without boxes":
        boxes.unlink()
    if kind == "a video of one frame":
        kitchen_films.write_video(film, [np.zeros((48, 64, 3), np.uint8)], 10.0)
    if kind == "a video that is cut short":
        film.write_bytes(film.read_bytes()[:-900])
    argv = ("demos", "import-videos", films, "--boxes", "auto", *options, "--out", tmp_path / "new")
    assert gril(*argv) == 2
    (said,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("gril:")]
    assert words in said
    assert [path.name for path in tmp_path.iterdir()] == ["films"]


def test_too_few_films_leave_no_run_in_the_way(home, tmp_path, capsys):
    films = shutil.copytree(home / "films", tmp_path / "films")
    for number in (2, 3, 4):
        (films / f"kitchen_0{number}.mp4").unlink()
    out = ("--out", tmp_path / "mine")
    assert gril("demos", "import-videos", films, "--boxes", "auto", "--robot", "hand", *out) == 0
    assert gril("pretrain", "--demos", tmp_path / "mine", "--out", tmp_path / "run") == 2
    assert "holds 2 demonstrations, but at least 3 are needed" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_both_stages_are_found_in_films_of_a_rough_tracker(tmp_path):
    stories = kitchen_films.write_films(
        tmp_path / "films", tracker=kitchen_films.ROUGH, width=320, height=240
    )
    films = ("demos", "import-videos", tmp_path / "films", "--boxes", "auto", "--robot", "hand")
    assert gril(*films, "--out", tmp_path / "mine") == 0
    assert gril("pretrain", "--demos", tmp_path / "mine", "--out", tmp_path / "run") == 0
    assert gril("subtasks", tmp_path / "run") == 0
    found = json.loads((tmp_path / "run" / "subtasks" / "subtasks.json").read_text())
    errors = []
    for name, one in found["demonstrations"].items():
        ends = np.array(one["ends"]) / 10
        true = np.array(stories[name].ends) / stories[name].fps
        assert len(ends) == 2
        errors += np.abs(ends - true).tolist()
    assert np.median(errors) <= 0.2


def test_objects_that_a_film_lacks_and_several_of_a_class_are_nodes(home, tmp_path, capsys):
    films = shutil.copytree(home / "films", tmp_path / "films")
    for number in (0, 1):
        boxes = films / f"kitchen_0{number}.csv"
        rows = boxes.read_text().splitlines()
        if number == 0:
            rows = [row for row in rows if ",spoon," not in row]
        else:
            rows += [f"{t},cup,50,2,56,8,0.9,77" for t in range(40)]
        boxes.write_text("\n".join(rows))
    out = ("--out", tmp_path / "mine")
    assert gril("demos", "import-videos", films, "--boxes", "auto", "--robot", "hand", *out) == 0
    said = capsys.readouterr().out
    assert "2 x cup" in said
    assert "doubtful: kitchen_00 never shows spoon" in said
    batch = demo_batch(load_demo_set(tmp_path / "mine"))
    assert load_demo_set(tmp_path / "mine").classes == (
        "coaster",
        "cup 1",
        "cup 2",
        "hand",
        "spoon",
    )
    present = np.asarray(batch.present)
    assert present.sum(axis=1).tolist() == [3, 5, 4, 4, 4]
    assert present[1].all()


def test_a_task_learns_from_films_as_noisy_as_they_are(home, capsys, monkeypatch):
    """The noise of the boxes goes with them where a task is named, too, unless one says it."""
    from gril_jax.cli.verbs import training

    header = json.loads((home / "mine" / "demos.json").read_text())
    rough = home / "rough"
    rough.mkdir()
    (rough / "demos.json").write_text(json.dumps(header | {"noise": 0.004, "smoothing": 3}))
    (home / "noted.yaml").write_text("pool: {noise: 0.1}\n")
    found = []
    take = lambda *_, config, **__: found.append(config.pool) or (lambda: 0)  # noqa: E731
    monkeypatch.setattr(training, "experiment", take)
    task = ["--task", "move_to_corner"]
    for args in (task, ["quickstart"], [str(home / "noted.yaml")], [*task, "--pool.noise", "0.2"]):
        assert main.main(["train", *args, "--demos", str(rough)]) == 0
    assert [(pool.noise, pool.rule()["smoothing"]) for pool in found] == [
        (0.004, 3), (0.004, 3), (0.1, 3), (0.2, 3),
    ]  # fmt: skip


def test_each_set_of_a_sweep_has_its_own_noise(home, tmp_path, monkeypatch):
    """As a value of an axis, and where one set is given to all."""
    from gril_jax.cli.verbs import sweep

    header = json.loads((home / "mine" / "demos.json").read_text())
    for name, noise in (("calm", None), ("rough", 0.004)):
        (tmp_path / name).mkdir()
        known = {} if noise is None else {"noise": noise, "smoothing": 3}
        (tmp_path / name / "demos.json").write_text(json.dumps(header | known))
    planned = []

    def made(plan, *args, **_):
        planned[:] = plan.config, [*plan.rows.values()]
        return lambda: None

    monkeypatch.setattr(sweep, "_made", made)
    ((verb,),) = sweep.VERBS.values()
    for option in ("--demos", "--demos.path"):
        verb.plan(["quickstart", option, f"{tmp_path}/calm,{tmp_path}/rough"])
        _, found = planned
        assert [row.pool.noise for row in found] == [None, 0.004]
        assert [row.pool.rule()["smoothing"] for row in found] == [1, 3]
        verb.plan(["quickstart", option, f"{tmp_path}/rough"])
        config, found = planned
        assert config.pool.noise == found[0].pool.noise == 0.004
