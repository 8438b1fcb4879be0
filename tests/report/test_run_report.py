"""A run's report: complete, self-contained, and plain about what is missing."""

import base64
import dataclasses
import hashlib
import html.parser
import json
import re
import shutil

import cv2
import numpy as np
import pytest
from support.run_folders import RESULTS, save_demos, save_profiles, save_run

from gril_jax.config import PPOConfig, RunConfig, RunSettings
from gril_jax.errors import RunError
from gril_jax.report.headline import headline
from gril_jax.report.html import Cell, Section, Table, render
from gril_jax.report.run_report import write_report

PICTURES = {"demos", "reward_profile", "rl_curve", "pretrain"}
VIDEOS = {"rollout"}
VOID = {"meta", "img", "link", "br", "hr", "input"}
HOSTILE = '<script>alert("x")</script>&'


class Page(html.parser.HTMLParser):
    """A page as a browser reads it: its tags, its addresses, and its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.addresses, self.text, self._open = [], [], "", []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self._open += [] if tag in VOID else [tag]
        for name, value in attrs:
            assert not name.startswith("on"), f"{tag} has a handler {name}"
            if name in ("src", "href", "srcset", "data", "poster", "action"):
                self.addresses.append(value)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.text += data


def report(folder):
    return Page(write_report(folder).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run with its report; tests only read it."""
    folder = save_run(tmp_path_factory.mktemp("runs") / "my run")
    return folder, report(folder)


@pytest.fixture
def copied(tmp_path, finished):
    return shutil.copytree(finished[0], tmp_path / "run")


@pytest.fixture
def run(copied, monkeypatch):
    """A copy of the finished run, to be changed; its pictures are drawn, but not made PNGs."""
    monkeypatch.setattr("gril_jax.report.run_report.png", lambda figure: b"a picture")
    return copied


# --- a whole run


@pytest.mark.parametrize("name", sorted(PICTURES))
def test_every_picture_is_a_png_that_is_not_blank(finished, name):
    image = cv2.imread(str(finished[0] / f"{name}.png"))
    assert image.shape[1] == 736
    assert image.shape[0] > 300
    assert (image != 255).any(-1).mean() > 0.01


def test_the_page_is_well_formed_and_loads_nothing(finished):
    _, page = finished
    assert len(page.addresses) == len(PICTURES | VIDEOS)
    for address in page.addresses:
        assert re.match(r"data:(image/png|video/mp4);base64,[A-Za-z0-9+/=]+$", address)
    assert "script" not in page.tags
    assert "link" not in page.tags


def test_the_page_holds_the_very_files_that_were_written(finished):
    folder, page = finished
    inside = {hashlib.sha256(_bytes(address)).digest() for address in page.addresses}
    files = [folder / f"{n}.png" for n in PICTURES] + [folder / f"{n}.mp4" for n in VIDEOS]
    assert inside == {hashlib.sha256(file.read_bytes()).digest() for file in files}


def _bytes(address):
    return base64.b64decode(address.split(",")[1])


@pytest.mark.parametrize(
    "text",
    [
        "GRIL run my run",
        "90.0%",
        "18 of 20 Jitter starts; 95% Wilson interval 69.9% to 97.2%",
        "1 of 20 Jitter starts",
        "5 of 20 Layout starts",
        "0.912",
        "0.834",
        "64,000",
        "17",
        "gril train x",
        "1 x cpu",
        "drawn for a test",
        "num_timesteps: 1000000",
        "gril export",
        "--what policy",
        "jax",
    ],
)
def test_the_page_says_what_was_run_and_what_came_of_it(finished, text):
    assert text in finished[1].text


def test_a_policy_of_several_networks_is_not_to_be_exported(tmp_path, monkeypatch):
    monkeypatch.setattr("gril_jax.report.run_report.png", lambda figure: b"a picture")
    staged = RunConfig(ppo=PPOConfig(sub_policies=2), run=RunSettings(reward="stages"))
    assert "--what policy" not in report(save_run(tmp_path / "run", config=staged)).text


def test_every_picture_has_a_caption_and_an_alternative_text(finished):
    folder, page = finished
    assert page.tags.count("figcaption") == page.tags.count("figure") == 5
    assert 'alt=""' not in (folder / "report.html").read_text()


def test_the_same_folder_gives_the_same_files(copied):
    files = ["report.html", *(f"{n}.png" for n in PICTURES), *(f"{n}.mp4" for n in VIDEOS)]
    drawn = []
    for _ in range(2):
        write_report(copied)
        drawn.append({name: (copied / name).read_bytes() for name in files})
    assert [name for name in files if drawn[0][name] != drawn[1][name]] == []


def test_verdict_film_numbers_curve_and_profile_come_first_and_in_this_order(finished):
    text = (finished[0] / "report.html").read_text(encoding="utf-8")
    marks = [
        'class="verdict good"', "<video", 'class="tiles"', "Success rate and mean reward",
        "Learned reward against frames", "<section>",
    ]  # fmt: skip
    places = [text.index(mark) for mark in marks]
    assert places == sorted(places)


# --- what comes from files is text, never markup


def test_names_from_files_are_escaped(tmp_path):
    names = (f"{HOSTILE}1", f"{HOSTILE}2", "</title><img src=x onerror=alert(1)>")
    folder = save_run(
        tmp_path / "<b>run&lt;", names=names, results={**RESULTS, HOSTILE: "<i>odd</i>"}
    )
    versions = json.loads((folder / "versions.json").read_text())
    versions["command"] = versions["packages"]["jax"] = f"gril {HOSTILE}"
    (folder / "versions.json").write_text(json.dumps(versions))
    page = report(folder)
    assert not {"script", "i", "title"} & set(page.tags[page.tags.index("body") :])
    assert page.tags.count("b") == len(headline(RESULTS))
    assert len(page.addresses) == 5
    for text in (f"{HOSTILE}2", "GRIL run <b>run&lt;", "<i>odd</i>", f"gril {HOSTILE}"):
        assert text in page.text


# --- missing parts


def test_a_run_that_only_learned_a_reward_says_that_there_is_no_policy(tmp_path):
    results = {"tau": 0.5}
    page = report(save_run(tmp_path / "run", ppo=0, results=results))
    assert "No policy has been trained in this run." in page.text
    assert "0.500" in page.text
    assert len(page.addresses) == 3


def test_an_unfinished_run_shows_what_there_is(run):
    for name in ("results.json", "rollouts.npz", "rollout.mp4"):
        (run / name).unlink()
    page = report(run)
    assert "has not finished" in page.text
    assert "was not recorded" in page.text
    assert len(page.addresses) == 4


def test_a_run_that_has_only_begun_still_has_a_page(run):
    for path in run.iterdir():
        if path.is_file() and path.name not in ("config.yaml", "phases.json"):
            path.unlink()
    shutil.rmtree(run / "demos")
    page = report(run)
    assert page.addresses == []
    for sentence in ("holds no demonstrations", "not been learned", "no metrics", "No policy"):
        assert sentence in page.text


def test_demonstrations_elsewhere_are_shown_while_they_are_there(tmp_path):
    save_demos(tmp_path / "kept", source="from elsewhere")
    folder = save_run(tmp_path / "run", demos_path=tmp_path / "kept")
    assert "from elsewhere" in report(folder).text
    (tmp_path / "kept").rename(tmp_path / "moved")
    page = report(folder)
    assert f"were in {tmp_path / 'kept'}, where they are no more" in page.text
    assert len(page.addresses) == 4  # the profile is drawn without frames


def test_demonstrations_longer_than_their_profiles_are_cut(run):
    save_profiles(run, length=np.array([5, 6, 7], np.int32))
    assert len(report(run).addresses) == 5


def test_a_demonstration_that_the_set_does_not_have_is_drawn_without_frames(run):
    save_profiles(run, names=("x", "y", "z"))
    page = report(run)
    assert "along y" in page.text
    assert "frames above" not in page.text


def test_the_learning_curve_says_what_its_evaluations_count(run):
    assert "Marks" not in report(run).text
    with (run / "metrics.jsonl").open("a") as file:
        row = {"phase": "ppo", "env_steps": 9000, "eval/success": 0.5, "eval/episodes": 8}
        file.write(json.dumps(row) + "\n")
    text = report(run).text
    assert "Marks: evaluations in between, 8 fresh starts for either kind." in text
    assert "Dashes: a random policy, 20 Jitter starts." in text


def test_a_run_on_the_tasks_own_reward_does_not_call_it_learned(tmp_path):
    settings = dataclasses.replace(RunSettings(), reward="environmental")
    page = report(save_run(tmp_path / "run", config=RunConfig(run=settings)))
    assert "environmental reward" in page.text


# --- damaged files


@pytest.mark.parametrize(
    "name",
    ["profiles.npz", "rollouts.npz", "rollout.mp4", "versions.json", "results.json",
     "demos/demos.json", "demos/000.mp4", "demos/001.npz", "config.yaml"],
)  # fmt: skip
def test_a_damaged_file_is_one_sentence_that_names_it(run, name):
    data = (run / name).read_bytes()
    (run / name).write_bytes(data[: len(data) // 2] + b"\x00[")
    with pytest.raises(RunError, match=re.escape(name.split("/")[-1])) as error:
        write_report(run)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("results.json", "[1]", "must be an object"),
        ("results.json", '{"tau": "high"}', "tau must be a number"),
        ("results.json", '{"success": 7}', "success is 7, but must be from 0 to 1"),
        ("versions.json", '{"packages": 3}', "packages another"),
        ("metrics.jsonl", "3\n", "line 1 must be an object"),
        ("metrics.jsonl", '{"phase": "ppo"}\n', "'env_steps' is missing"),
        ("metrics.jsonl", '{"phase": "ppo", "env_steps": [1]}\n', "must be a number"),
        ("metrics.jsonl", '{"phase": "ppo", "env_steps": 1e300}\n', "beyond all bounds"),
    ],
)
def test_a_value_of_the_wrong_kind_is_one_sentence(run, name, text, message):
    (run / name).write_text(text)
    with pytest.raises(RunError, match=message):
        write_report(run)


def test_a_profile_longer_than_its_video_is_refused(run):
    wide = np.zeros((3, 20), np.float32)
    save_profiles(run, reward=wide, transitions=wide > 0, length=np.array([20] * 3, np.int32))
    with pytest.raises(RunError, match="profile of 'two' has 20 frames, but its video has 8"):
        write_report(run)


def test_a_file_that_cannot_be_written_is_one_sentence(run):
    (run / "report.html").unlink()
    (run / "report.html").mkdir()
    with pytest.raises(RunError, match="cannot be written to"):
        write_report(run)


# --- tables

MARKUP = "<b>x</b>&"


def _page(*tables):
    return render("title", "summary", [], [Section("numbers", tables)], {}, {}, {})


def _cells(html, tag):
    return re.findall(rf"<{tag}[^>]*>(.*?)</{tag}>", html)


def test_a_table_has_its_headings_across_and_its_rows_down():
    rows = {
        "first": [Cell("1.5", "1 to 2"), Cell("never")],
        "second": [Cell("10.0"), Cell("")],
    }
    page = _page(Table("what it is", ["a", "b"], rows))
    head, *body = _cells(re.search("<thead>.*</tbody>", page, re.DOTALL)[0].replace("\n", ""), "tr")
    assert (_cells(head, "td"), _cells(head, "th")) == ([""], ["a", "b"])
    assert [_cells(row, "th") for row in body] == [["first"], ["second"]]
    assert [_cells(row, "td") for row in body] == [
        ["1.5<small>1 to 2</small>", "never"],
        ["10.0", ""],
    ]
    assert "<figcaption>what it is</figcaption>" in page


def test_a_table_is_scrolled_by_itself_and_from_the_keyboard_too():
    page = _page(Table("what it is", ["a"], {"row": [Cell("1")]}))
    assert '<div class="wide" tabindex="0" role="region" aria-label="what it is"><table>' in page
    assert ".wide { overflow-x: auto; }" in page


def test_what_stands_in_a_table_is_text():
    page = _page(Table(f'{MARKUP}"', [MARKUP], {MARKUP: [Cell(MARKUP, MARKUP)]}))
    assert "<b>" not in page
    assert page.count("&lt;b&gt;x&lt;/b&gt;&amp;") == 6
    assert 'aria-label="&lt;b&gt;x&lt;/b&gt;&amp;&quot;"' in page


def test_a_row_of_another_length_than_the_headings_is_a_mistake():
    with pytest.raises(ValueError, match="shorter"):
        _page(Table("", ["a", "b"], {"row": [Cell("1")]}))
