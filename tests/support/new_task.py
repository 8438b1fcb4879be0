"""A task as another package may bring it: a folder with an entry and its code, and a YAML file."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

TASK = """
    import jax
    import jax.numpy as jnp
    import numpy as np
    from gril_jax.envs.base import Demonstrations, Episode, Film, Objects, Outline, State


    class Reach:
        classes = ("goal", "robot")
        observation_size, action_size = 2, 2
        control_hz, half_extent, background = 10.0, 1.0, (255, 255, 255)
        stages = None

        def __init__(self, *, reward: str = "near", episode_length: int = 20):
            self.episode_length = episode_length

        def reset(self, key):
            return self._state(jax.random.uniform(key, (2,), minval=-0.8, maxval=0.8))

        def step(self, state, action):
            return self._state(jnp.clip(state.data + 0.1 * action, -1.0, 1.0))

        def _state(self, place):
            away = jnp.sqrt(jnp.sum(place**2) + 1e-9)
            success = (away < 0.2).astype(jnp.float32)
            none, size = jnp.zeros(2), jnp.full((2, 2), 0.2)
            objects = Objects(
                jnp.stack([none, place]), size, jnp.arange(2), jnp.array([False, True])
            )
            metrics = {"score": success, "success": success, "varied": 0 * success}
            still = jnp.zeros(2, bool)
            return State(place, place, objects, still, -away, jnp.zeros(()), metrics)

        def outlines(self, data):
            box = 0.1 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            return [Outline(box + np.asarray(at), (9, 9, 9), None) for at in (np.zeros(2), data)]


    def demonstrate(make, wanted, tell):
        env, rng = make(), np.random.default_rng(wanted.seed)
        ends = ["success"] * wanted.successes + ["failure"] * wanted.failures
        begins = rng.uniform(0.3, 0.8, (len(ends), 2))
        tell(len(ends))
        return Demonstrations(
            env, env.classes, [Episode(end, end, None) for end in ends],
            (film(begin, end) for begin, end in zip(begins, ends)),
        )


    def film(begin, end):
        way = np.linspace(begin, begin * (end == "failure"), 12)
        center = np.stack([0 * way, way], axis=1).astype(np.float32)
        size = np.full(center.shape, 0.2, np.float32)
        return Film(np.zeros((12, 16, 16, 3), np.uint8), center, size, np.ones((12, 2), bool))
"""
SPEC = """
    from gril_jax.envs import TaskSpec

    SPEC = TaskSpec(
        make="reach_task.task:Reach", demonstrate="reach_task.task:demonstrate", rewards=("near",)
    )
"""
# What makes it a task that every verb takes: a puck that moves by itself, stages, and rewards of
# the names that Table I asks for.
AUDITED = (
    ('"robot")', '"puck")'),
    ("jnp.array([False, True])", "jnp.zeros(2, bool)"),
    ("stages = None", "stages = put_inside((1,), 0, robots=(), half_extent=1.0)"),
    ("Outline, State\n", "Outline, State\n    from gril_jax.envs.stages import put_inside\n"),
    ('("near",)', '("near", "S4", "V5", "sparse")'),
)
CONFIG = """
    env: {name: reach, episode_length: 12}
    demos: {num: 4, num_validation: 2, num_failures: 1}
    encoder: {width: 8, latent: 4, robot: true}
    pretrain: {steps: 4, num_videos: 3}
    ppo: {num_envs: 8, unroll_length: 4, num_timesteps: 64, num_minibatches: 2, hidden: [8]}
    run: {eval_episodes: 2, evaluations: 0, updates_per_chunk: 1}
"""


def write(folder: Path, changes: Sequence[tuple[str, str]] = ()) -> Path:
    """Writes the task into a folder, which has to be on Python's path, with words changed to
    others; gives its configuration."""
    package = folder / "reach_task"
    package.mkdir()
    for name, text in (("__init__.py", SPEC), ("task.py", TASK)):
        for old, new in changes:
            text = text.replace(old, new)
        (package / name).write_text(textwrap.dedent(text))
    (folder / "reach.yaml").write_text(textwrap.dedent(CONFIG))
    return folder / "reach.yaml"
