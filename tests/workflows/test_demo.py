"""`gril demo`: the shipped policy plays, and its reward rises."""

from importlib import resources

import numpy as np

from gril_jax.demos.vision import video
from gril_jax.workflows import demo


def test_a_shipped_policy_succeeds_and_its_reward_rises(tmp_path):
    said = []
    path = demo.main(tmp_path / "new" / "demo.mp4", echo=said.append)
    frames = video.read_video(path)
    assert frames.shape[1:] == (512, 384, 3)
    assert "the policy succeeds" in said[1]
    low, high = said[0].strip()[0], said[0][-1]
    assert (low, high) == ("▁", "█")
    assert said[2] == f"video: {path}"


def test_what_is_shipped_is_small():
    files = [*(resources.files("gril_jax") / "assets").iterdir()]
    assert {file.name for file in files} == {"reward.npz", "policy.npz"}
    assert sum(len(file.read_bytes()) for file in files) < 300_000


def test_a_sparkline_has_a_block_for_each_of_its_values():
    assert demo.sparkline(np.array([0.0, 1.0])) == " █"
    assert demo.sparkline(np.linspace(0, 1, 200), width=9) == " ▁▂▃▄▅▆▇█"
    assert demo.sparkline(np.zeros(3)) == "   "
