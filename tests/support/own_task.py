"""A small task of one's own as text, with parts to be replaced, and a demonstration set of it."""

from pathlib import Path

import numpy as np

from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.files import write_demo_set

CLASSES = ("mat", "hand", "puck")
TASK = """
import jax
import jax.numpy as jnp
from gril_jax.envs import Objects, State

class Task:
    classes = ("mat", "hand", "puck")
    action_size, episode_length = 2, 8

    def reset(self, key):
        return self.state(jax.random.uniform(key, (2,), minval=-0.8, maxval=0.8))

    def step(self, state, action):
        return self.state(jnp.clip(state.data + 0.2 * action, -0.9, 0.9))

    def state(self, puck):
        center = jnp.stack([jnp.zeros(2), puck - 0.1, puck])
        seen = Objects(center, jnp.full((3, 2), 0.2), jnp.arange(3), jnp.arange(3) == 1)
        return State(puck, puck, seen, metrics={"success": (jnp.abs(puck) < 0.3).all()})

    def expert(self, state, key):
        return -5 * state.data

def make(speed=1.0):
    return Task()
"""
SMALL = """
demos: {num: 4, num_validation: 2, num_failures: 0}
encoder: {width: 8, latent: 4}
pretrain: {steps: 4, num_videos: 3}
ppo: {num_envs: 8, unroll_length: 4, num_timesteps: 64, num_minibatches: 2, hidden: [8]}
run: {eval_episodes: 4, evaluations: 0, updates_per_chunk: 1}
"""


def write(folder: Path, *, name: str = "my_task.py", **changed: str) -> Path:
    """Writes the task into a folder, texts replaced by others: `write(folder, old=new)` takes pairs
    under any keyword as (old, new)."""
    text = TASK
    for old, new in changed.values():
        assert old in text, old
        text = text.replace(old, new)
    (folder / name).write_text(text)
    (folder / "small.yaml").write_text(SMALL)
    return folder / name


def demonstrations(folder: Path, classes=CLASSES, *, half_extent: float = 1.0, robots=None) -> Path:
    """A set of five short videos in which the puck comes to the mat."""
    rng = np.random.default_rng(0)

    def films():
        for number in range(5):
            way = np.linspace(rng.uniform(0.4, 0.8, 2), [0, 0], 10)
            center = np.stack([0 * way, way - 0.1, way], axis=1).astype(np.float32)
            label = np.array([classes.index(c) if c in classes else 0 for c in CLASSES], np.int32)
            size = np.full(center.shape, 0.2, np.float32)
            tracks = Tracks(center, size, label, np.ones((10, 3), bool))
            yield Demo(f"video {number}", np.zeros((10, 16, 16, 3), np.uint8), tracks, 0, "success")

    about = {"task": "", "half_extent": half_extent, "fps": 10.0, "source": "a test"}
    write_demo_set(folder, films(), classes=classes, robots=robots, **about)
    return folder


def home(folder, monkeypatch):
    """The folder, with the task and its videos, as the working directory of a new user."""
    write(folder)
    demonstrations(folder / "mine")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    return folder
