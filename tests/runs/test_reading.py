"""What a command reads of a run is what the run wrote, and of a run of one policy."""

import json
import shutil

import pytest
from support.run_folders import save_run

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.report.run_report import write_report
from gril_jax.runs import reading, run_dir
from gril_jax.runs.reading import require_single


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run whose files are reading."""
    return save_run(tmp_path_factory.mktemp("covered") / "run", covered=True)


@pytest.fixture
def run(finished, tmp_path):
    """A copy of it that may be damaged."""
    return shutil.copytree(finished, tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("results.json", "0.912", "0.913"),
        ("versions.json", "1 x cpu", "2 x cpu"),
        ("metrics.jsonl", '"loss": 2.0', '"loss": 3.0'),
        ("config.yaml", "seed: 0", "seed: 1"),
        ("config.yaml", "seed: 0", "seed: 0  # as ever"),
        ("phases.json", '"train"', '"pretrain"'),
    ],
)
def test_a_value_that_was_changed_is_refused(run, name, old, new):
    text = (run / name).read_text()
    (run / name).write_text(text.replace(old, new, 1))
    if name == "phases.json":
        (run / name).write_text(text.replace('"experiment"', '"Experiment"'))
    with pytest.raises(RunError, match=name) as error:
        write_report(run)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["results.json", "versions.json", "metrics.jsonl", "phases.json"])
@pytest.mark.parametrize("damage", ["lost", "emptied"])
def test_a_file_that_was_lost_is_refused(run, name, damage):
    (run / name).unlink()
    if damage == "emptied":
        (run / name).touch()
    with pytest.raises(RunError, match=name):
        write_report(run)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [(None, "", "is empty"), ("seed: 0", "seed: 3", "has been changed since the run began: ")],
)
def test_another_configuration_is_refused(run, old, new, fault):
    file = run / "config.yaml"
    file.write_text(file.read_text().replace(old, new, 1) if old else new)
    with pytest.raises(RunError, match=rf"config\.yaml {fault}"):
        run_dir.read_config(run)


def test_a_run_of_another_version_is_told_so(run):
    """Its fields may be others."""
    file = run / "config.yaml"
    file.write_text("old: 1\n" + file.read_text())
    for name, said in (("0.0.9", ": gril-jax 0.0.9 made the run, and this is "), (None, "")):
        made = json.loads((run / "versions.json").read_text())
        made["packages"] = {"gril-jax": name} if name else {}
        (run / "versions.json").write_text(json.dumps(made))
        with pytest.raises(RunError, match=r"there is no section .old.") as error:
            run_dir.read_config(run)
        assert ("made the run" in str(error.value)) == bool(name)
        assert said in str(error.value)


def test_of_damaged_metrics_the_lines_are_named(run):
    file = run / "metrics.jsonl"
    lines = file.read_text().splitlines(keepends=True)
    for changed, fault in (
        ([*lines[:2], "{]\n", *lines[3:]], "line 3 is not JSON"),
        ([lines[1], lines[0], *lines[2:]], "lines 1 to 10 are not those"),
        (lines[:-1], "holds 9 whole lines, but the run had written 10"),
        ([*lines, lines[-1]], "goes on after the last line"),
    ):
        file.write_text("".join(changed))
        with pytest.raises(RunError, match=fault):
            run_dir.read_metrics(run)


def test_a_demonstration_set_must_be_the_one_that_the_run_began_with(tmp_path):
    path, header = tmp_path / "run", tmp_path / "run" / "demos" / "demos.json"
    with run_dir.create(path, RunConfig(), device="cpu") as run:
        header.parent.mkdir()
        header.write_text("{}")
        run.finish_phase("demos", {"sha256": reading.digest(header)}, [header])
    reading.require_same_demos(path, header)
    header.write_text("{ }")
    with pytest.raises(RunError, match=r"demos\.json has been changed since the run wrote it"):
        reading.require_same_demos(path, header)


def test_results_that_were_lost_can_be_made_again(tmp_path):
    path = tmp_path / "run"
    with run_dir.create(path, RunConfig(), device="cpu", experiment="train") as run:
        run.finish({"tau": 0.5})
    (path / "results.json").unlink()
    with pytest.raises(RunError, match=r"results\.json is missing, but the run had written it"):
        run_dir.read_results(path)
    with run_dir.resume(path) as run:
        run.finish({"tau": 0.5})
    assert run_dir.read_results(path) == {"tau": 0.5}


@pytest.fixture
def made(tmp_path):
    def make(experiment):
        path = tmp_path / "run"
        run_dir.create(path, RunConfig(), device="a test", experiment=experiment).close()
        return path

    return make


@pytest.mark.parametrize(
    ("experiment", "where"),
    [
        ("sweep", "its page is report.html, its table study.md"),
        ("novel", "its results lie there in files of their own"),
    ],
)
def test_a_table_s_run_is_refused_and_nothing_of_it_is_overwritten(made, experiment, where):
    path = made(experiment)
    (path / "report.html").write_text("the table's own page")
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    with pytest.raises(RunError, match=f"holds a run of gril {experiment}, .*{where}") as error:
        write_report(path)
    assert "\n" not in str(error.value)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before


@pytest.mark.parametrize("text", ["", "[", "[1]", "{}", '{"experiment": 3}', "\xff"])
def test_damage_is_one_sentence_that_names_the_file(made, text):
    path = made("train")
    require_single(path)
    (path / "phases.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(RunError, match=r"phases\.json"):
        require_single(path)
