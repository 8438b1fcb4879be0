"""A finger slides a ball onto a plate: a model in slide.xml, stepped by MuJoCo MJX.

    gril demos make --task slide.py:make --out mine
    gril train slide.yaml --task slide.py:make --demos mine

Seen from above in metres, |x|, |y| <= 0.5; the finger is driven by forces, at 10 Hz.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
from gril_jax.envs import Objects, State
from gril_jax.envs.stages import put_inside
from mujoco import mjx

PLATE = jnp.array([0.3, 0.0])
SIZES = jnp.array([[0.26, 0.26], [0.08, 0.08], [0.12, 0.12]])
SUBSTEPS = 5  # of 0.02 s


class Slide:
    classes = ("plate", "finger", "ball")
    action_size, episode_length, control_hz, half_extent = 2, 60, 10.0, 0.5
    stages = put_inside((2,), 0, robots=(1,), half_extent=0.5)

    def __init__(self):
        xml = Path(__file__).with_name("slide.xml").read_text()
        self.model = mjx.put_model(mujoco.MjModel.from_xml_string(xml))

    def reset(self, key):
        key_ball, key_angle = jax.random.split(key)
        ball = jax.random.uniform(key_ball, (2,), minval=-0.25, maxval=0.1)
        angle = jax.random.uniform(key_angle, (), maxval=2 * jnp.pi)
        finger = ball + 0.16 * jnp.array([jnp.cos(angle), jnp.sin(angle)])
        data = mjx.make_data(self.model)
        data = data.replace(qpos=jnp.concatenate([finger, ball]))
        return self.state(mjx.forward(self.model, data))

    def step(self, state, action):
        def substep(data, _):
            return mjx.step(self.model, data), None

        data = state.data.replace(ctrl=jnp.clip(action, -1, 1))
        return self.state(jax.lax.scan(substep, data, length=SUBSTEPS)[0])

    def state(self, data):
        finger, ball = data.qpos[:2], data.qpos[2:]
        center = jnp.stack([PLATE, finger, ball])
        objects = Objects(center, SIZES, jnp.arange(3), jnp.array([False, True, False]))
        obs = jnp.concatenate([4 * data.qpos, 2 * data.qvel, 4 * (ball - finger)])
        success = (jnp.abs(ball - PLATE) < SIZES[0] / 2).all()
        return State(data, obs, objects, metrics={"success": success})

    def expert(self, state, key):
        """A servo to a point behind the ball, then through it."""
        finger, ball = state.data.qpos[:2], state.data.qpos[2:]
        way = (PLATE - ball) / (jnp.linalg.norm(PLATE - ball) + 1e-6)
        side = jnp.array([-way[1], way[0]])
        along, across = (finger - ball) @ way, (finger - ball) @ side
        around = ball - 0.13 * way + 0.15 * side * jnp.where(across < 0, -1.0, 1.0)
        behind = jnp.where(jnp.abs(across) < 0.03, ball, ball - 0.13 * way)
        aim = jnp.where(along > -0.06, around, behind)
        force = 12 * (aim - finger) - 0.8 * state.data.qvel[:2]
        near = jnp.abs(ball - PLATE).max() < 0.08
        noise = 0.05 * jax.random.normal(key, (2,))
        return jnp.where(near, -state.data.qvel[:2], jnp.clip(force, -1, 1)) + noise


def make():
    return Slide()
