"""Plays a policy that is shipped with the package beside the reward it was trained on: `gril demo`.

Both files are of `gril quickstart`, seed 0:

    gril export RUN --out gril_jax/assets/reward.npz
    gril export RUN --what policy --out gril_jax/assets/policy.npz
"""

from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from gril_jax import envs
from gril_jax.demos.vision import video
from gril_jax.envs import Env
from gril_jax.export import read_policy
from gril_jax.export.reward_file import load_reward
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.workflows.build import filming

_ASSETS = resources.files("gril_jax") / "assets"
_AFTER = 16  # frames that the video goes on after success
_PLOT = 128  # height of the reward's curve under a frame, pixels
_BLUE, _GREY = (0, 114, 178), (160, 160, 160)


def main(out: Path, *, seed: int = 0, echo: Callable[[str], None] = print) -> Path:
    """Plays one episode and writes its video, with the reward's curve under each frame; its path.

    The seed chooses where everything stands at the start.
    """
    with resources.as_file(_ASSETS) as folder:
        reward = load_reward(folder / "reward.npz")
        about, _ = read_policy.unpack(folder / "policy.npz")
        act = read_policy.load_policy(folder / "policy.npz")
    env = about["env"]
    task = envs.make(
        env["name"], targets=(*env["targets"],), distractors=(*env["distractors"],),
        observation=env["observation"], variant=env["variant"], varied_starts=0.0,
    )  # fmt: skip
    states, rewards = play(task, reward, act, seed)
    done = states.metrics["success"] > 0.5
    success = bool(done[-1])
    if success:  # what follows shows nothing new
        shown = slice(len(done) - int(np.argmin(done[::-1])) + _AFTER)
        states, rewards = jax.tree.map(lambda x: x[shown], states), rewards[shown]
    echo(sparkline(rewards))
    echo(
        f"the reward goes from {rewards[0]:.2f} to {rewards[-1]:.2f} in {len(rewards)} control "
        f"steps; the policy {'succeeds' if success else 'fails'}"
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    frames = with_curve(filming.episode(task, states), rewards)
    video.write_video(out, frames, task.control_hz)
    echo(f"video: {out}")
    return out


def play(
    task: Env, reward: LearnedReward, act: Callable[[Any], np.ndarray], seed: int
) -> tuple[Any, Float[np.ndarray, "T"]]:
    """An episode's states, leaves (T, ...), and the reward of each. The policy sees the task's
    observation and which objects have moved."""
    step, rewarded = jax.jit(task.step), jax.jit(reward.step)
    state = jax.jit(task.reset)(jax.random.key(seed))
    memory = reward.init(state.objects.center, state.objects.size)
    states, rewards = [], []
    for _ in range(task.episode_length):
        bits = np.asarray(memory.activity.active, np.float32)
        state = step(state, jnp.asarray(act(np.concatenate([state.obs, bits]))))
        memory, value = rewarded(memory, state.objects.center, state.objects.size)
        states.append(jax.device_get(state))
        rewards.append(float(value))
    return jax.tree.map(lambda *x: np.stack(x), *states), np.array(rewards)


def sparkline(values: Float[np.ndarray, "T"], width: int = 60) -> str:
    """The values as a line of blocks, lowest to highest; at most `width` of them."""
    blocks = " ▁▂▃▄▅▆▇█"
    chosen = values[np.linspace(0, len(values) - 1, min(width, len(values))).astype(int)]
    low, high = float(values.min()), float(values.max())
    scaled = (chosen - low) / max(high - low, 1e-9)
    return "".join(blocks[round(x * (len(blocks) - 1))] for x in scaled)


def with_curve(
    frames: UInt8[np.ndarray, "T P P 3"], rewards: Float[np.ndarray, "T"]
) -> UInt8[np.ndarray, "T P+128 P 3"]:
    """The frames, and under each the curve of the reward up to it."""
    width = frames.shape[2]
    low, high = min(float(rewards.min()), -1.0), max(float(rewards.max()), 0.0)
    x = np.linspace(8, width - 8, len(rewards))
    y = 12 + (high - rewards) / (high - low) * (_PLOT - 24)
    points = np.stack([x, y], axis=1).astype(np.int32)
    zero = int(12 + high / (high - low) * (_PLOT - 24))
    found = []
    for number, frame in enumerate(frames, 1):
        plot = np.full((_PLOT, width, 3), 255, np.uint8)
        cv2.line(plot, (8, zero), (width - 8, zero), _GREY, 1)
        cv2.putText(
            plot, "reward 0: the goal", (8, max(zero - 3, 9)), cv2.FONT_HERSHEY_SIMPLEX, 0.3,
            _GREY, 1, cv2.LINE_AA,
        )  # fmt: skip
        cv2.polylines(plot, [points[:number]], False, _BLUE, 2, cv2.LINE_AA)
        cv2.circle(plot, points[number - 1].tolist(), 4, _BLUE, -1, cv2.LINE_AA)
        found.append(np.concatenate([frame, plot]))
    return np.stack(found)
