"""The notebook of the documentation runs from top to bottom, with smaller numbers."""

import json

import matplotlib
import pytest
from support.paths import REPOSITORY

NOTEBOOK = REPOSITORY / "docs" / "notebooks" / "videos_to_policy.ipynb"
SMALLER = {
    "NUM_DEMOS = 24": "NUM_DEMOS = 8",
    "REWARD_STEPS = 2_000": "REWARD_STEPS = 20",
    "POLICY_STEPS = 3_000_000": "POLICY_STEPS = 7_680",
    "ascents=100": "ascents=8",
    "episodes=128": "episodes=4",
}


def _cells():
    notebook = json.loads(NOTEBOOK.read_text())
    return [cell["source"] for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg")
def test_the_notebook_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(matplotlib, "use", lambda *_: None)  # it shows nothing here
    cells, names = _cells(), {}
    for number, cell in enumerate(cells):
        for large, small in SMALLER.items():
            cell = cell.replace(large, small)
        exec(compile(cell, f"cell {number}", "exec"), names)
    assert len(names["policy"]) == 2
    assert (tmp_path / "reward.npz").is_file()
    assert (tmp_path / "policy.mp4").is_file()


def test_what_is_made_smaller_is_in_the_notebook():
    text = "\n".join(_cells())
    assert all(large in text for large in SMALLER)
