"""The documentation is true: Python runs, commands are understood, links lead somewhere."""

import importlib.util
import json
import os
import re
import shlex
from pathlib import Path

import pytest
from support import kitchen_films, saved_policies, saved_rewards
from support.paths import REPOSITORY

import gril_jax
from gril_jax.cli import main, verbs
from gril_jax.config import RunConfig
from gril_jax.config.command_line import options
from gril_jax.errors import ConfigError
from gril_jax.export.reward_file import save_reward
from gril_jax.runs import run_dir
from gril_jax.workflows.study import recipe, saved

PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "envs/*.md", "experiments/results/**/*.md")
    for path in REPOSITORY.glob(pattern)
)
RESULTS = REPOSITORY / "experiments" / "results"
ATTRIBUTES = {"env.render", "env.reset_to"}  # of a task, and no options of the configuration
# Commands with options of their own, and one of theirs.
OTHERS = {"pip", "python", "srun", "sbatch", "make", "--signal=TERM@120"}


def _name(path):
    return path.relative_to(REPOSITORY).as_posix()


def _blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)


# --- Python


@pytest.mark.parametrize("path", [p for p in PAGES if _blocks(p, "python")], ids=_name)
def test_the_python_of_a_page_runs_from_top_to_bottom(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = saved_rewards.CONFIGS["paper"]
    save_reward(
        "reward.npz", saved_rewards.made(config), config, classes=saved_rewards.CLASSES,
        robots=("robot",), objects=saved_rewards.OBJECTS[:3],
    )  # fmt: skip
    saved_policies.write("policy.npz")
    kitchen_films.write_films(tmp_path / "videos", 2, fps=10.0, width=64, height=48, tempo=2.0)
    names: dict = {}
    for block in _blocks(path, "python"):
        exec(compile(block, _name(path), "exec"), names)


def test_python_that_trains_for_minutes_names_what_there_is():
    """Its functions are called with the same arguments in `tests/api`."""
    for block in [block for path in PAGES for block in _blocks(path, "py")]:
        for name in re.findall(r"gril\.(\w+)\(", block):
            assert callable(getattr(gril_jax, name)), name


# --- commands


def _commands(path):
    """The command lines of `gril` in blocks of bash, and those that a result says it is made by."""
    text = path.read_text()
    lines = [line for block in _blocks(path, "bash") for line in block.splitlines()]
    if RESULTS in path.parents:
        made = re.findall(r"^- \*\*Commands?\*\*(.*(?:\n  .*)*)|^Made by (.*)$", text, re.MULTILINE)
        code = [c for said in made for c in re.findall(r"`([^`]*)`", " ".join(said))]
        lines += [part for c in code for part in " ".join(c.split()).split(" and gril ")]
    lines = [re.sub(r"^[A-Z_]+=\S+ (?=gril )", "", line) for line in lines]
    return [line for line in lines if line.startswith("gril ")]


@pytest.fixture
def surroundings(tmp_path, monkeypatch):
    """Values for the words in capitals of a command line."""
    monkeypatch.chdir(tmp_path)
    for folder in ("videos", "mine"):
        (tmp_path / folder).mkdir()
    demos = {"task": "match_regions", "demos": 40 * [{"outcome": "success"}]}
    (tmp_path / "mine" / "demos.json").write_text(json.dumps(demos))
    monkeypatch.setattr("gril_jax.runs.sinks.require_installed", lambda sinks: None)

    def of(resumed):
        run = tmp_path / f"run-{resumed}"
        if not run.exists():
            with run_dir.create(run, RunConfig(), device="cpu", experiment=resumed):
                rows = {"ours": RunConfig()}
                plan = saved.Plan(recipe.Study("mine"), RunConfig(), rows, {"ours": [0]})
                saved.write(run, plan)
            for name in ("policy/0", "reward/0"):
                (run / name).mkdir(parents=True)
                (run / name / "manifest.json").write_text("{}")
        demos = dict.fromkeys(("DEMOS", "HUMAN"), "mine")
        return {"RUN": str(run), "FOLDER": "videos", **demos}

    return of


UNDERSTOOD = set()  # many a command stands on several pages


@pytest.mark.parametrize("path", [p for p in PAGES if _commands(p)], ids=_name)
def test_the_commands_of_a_page_are_understood(path, surroundings):
    _write_files(path)
    for line in dict.fromkeys(_commands(path)):
        if line not in UNDERSTOOD or line.startswith("gril new-task"):
            _understood(line, surroundings)
            UNDERSTOOD.add(line)


def _write_files(path):
    """Writes the files that a page shows as a whole, whose first line is their name."""
    for block in _blocks(path, "python"):
        if found := re.match(r"# (\w+\.py)\n", block):
            Path(found[1]).write_text(block)


def test_the_task_of_the_page_is_found_to_be_as_the_page_says(tmp_path, monkeypatch, capsys):
    page = REPOSITORY / "docs" / "your_own_task.md"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    _write_files(page)
    (line,) = [line for line in _commands(page) if line.startswith("gril check-task")]
    assert main.main(shlex.split(line)[1:]) == 0
    found = capsys.readouterr().out.splitlines()
    (shown,) = [text for text in _blocks(page, "text") if text.startswith("push_puck: classes")]
    for said in shown.splitlines():
        assert said in (*found, "..."), said
    assert not any("MISSING" in said or "look " in said for said in found)


def _understood(line, surroundings):
    """Plans a command line, as far as the work that is left."""
    args = shlex.split(line, comments=True)[1:]
    stand_for = surroundings(args[0] if "--resume" in args else None)
    if "--out" not in args:  # a page's run of this name is made by an earlier command
        stand_for = stand_for | {"run": stand_for["RUN"]}
    work = main._plan([stand_for.get(arg, arg) for arg in args])
    assert callable(work), line
    if args[0] == "new-task":  # whose files the next lines name
        work()


CURRENT = [path for path in PAGES if path.name != "CHANGELOG.md"]  # which names what there was


def test_every_test_that_is_named_exists():
    for path in CURRENT:
        for name in re.findall(r"`[^`]*?(tests/[\w/]+\.py)", path.read_text()):
            assert (REPOSITORY / name).exists(), f"{name} in {path}"


def test_every_verb_that_is_named_exists():
    words = {verb for one in verbs.every() for verb in (one.name, one.name.split()[0])}
    for path in CURRENT:
        for code in re.findall(r"(?<!`)`gril ([^`]*)`", path.read_text()):
            verb = code.split()[0] if code else ""
            if not verb.startswith("-") and not verb.isupper():
                assert verb in words, f"gril {code} in {path}"


def _known_options():
    """Options of the configuration and of verbs, and those that the command line's sources name."""
    known = set(options(RunConfig)) | {"--help"}
    for verb in verbs.every():
        known |= set(options(verb.schema) if verb.schema else ())
    for path in (REPOSITORY / "gril_jax" / "cli").rglob("*.py"):
        known |= set(re.findall(r"--[a-z][a-z-]*", path.read_text()))
    return known


KNOWN = _known_options()
SECTIONS = {option[2:].partition(".")[0] for option in options(RunConfig) if "." in option}


def _without_blocks(path):
    return re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)


def test_every_option_that_is_named_exists():
    for code in re.findall(r"`([^`\n]+)`", "\n".join(map(_without_blocks, CURRENT))):
        first = (code.split() or [""])[0]
        if first in OTHERS or "XLA_FLAGS" in code:
            continue
        for option in re.findall(r"(?<![\w-])--[a-z][\w.-]*", code):
            assert option in KNOWN, f"{option} in `{code}`"
        section, _, field = first.partition(".")
        if section in SECTIONS and re.fullmatch(r"[a-z_]+", field) and first not in ATTRIBUTES:
            assert f"--{section}.{field}".replace("_", "-") in KNOWN, code


def test_a_stale_option_would_be_found(surroundings):
    with pytest.raises(ConfigError, match="--no-such-option"):
        _understood("gril train match_regions --no-such-option 1", surroundings)


# --- links


def _anchors(path):
    """The anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", _without_blocks(path), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}


def test_the_links_and_pictures_of_a_page_exist():
    for path in PAGES:
        for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
            if not target.startswith(("http://", "https://")):
                name, _, anchor = target.partition("#")
                aim = (path.parent / name).resolve() if name else path
                assert aim.exists(), f"{target} in {path} leads nowhere"
                assert not anchor or anchor in _anchors(aim), f"{target} in {path} has no heading"


def test_every_result_is_in_the_index_and_on_the_site():
    index = (RESULTS / "README.md").read_text()
    site = (REPOSITORY / "mkdocs.yml").read_text()
    for page in RESULTS.glob("*/README.md"):
        assert f"({page.parent.name}/README.md)" in index
        assert f"results/{page.parent.name}/README.md" in site


def test_tables_have_at_most_five_columns():
    for line in [line for path in PAGES for line in path.read_text().splitlines()]:
        if line.startswith("|"):
            assert len(re.findall(r"(?<!\\)\|", line)) <= 6, line


def test_the_front_pages_are_short():
    for path, most in ((REPOSITORY / "README.md", 120), (RESULTS / "README.md", 60)):
        assert len(path.read_text().splitlines()) <= most, os.fspath(path)


def test_the_page_of_options_is_that_of_the_code():
    spec = importlib.util.spec_from_file_location("options", REPOSITORY / "docs" / "options.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert made.PAGE.read_text() == made.page(), "run python docs/options.py"
