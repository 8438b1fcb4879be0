"""Two small tasks of Gymnasium's MuJoCo suite in MJX, with published returns.

Masses, gears, rewards and starts are those of InvertedPendulum-v5 and Reacher-v5; they are
integrated implicitly here, and by Runge-Kutta there.
"""

import contextlib
import io

import jax
import jax.numpy as jnp
from gril_jax.envs import State
from jaxtyping import Array, Float, PRNGKeyArray

from .pendulum import Bare

with contextlib.redirect_stdout(io.StringIO()):  # it reports on parts that are not installed
    import mujoco
    from mujoco import mjx

_SUBSTEPS = 2  # of a control step

# One Newton iteration needs no loop, and there is at most one limit of a joint to satisfy.
_OPTION = """
<option timestep="{timestep}" integrator="implicitfast" iterations="1" ls_iterations="4">
  <flag contact="disable" eulerdamp="disable"/>
</option>
"""
_CART = """
<mujoco>{option}
  <worldbody>
    <body>
      <joint type="slide" axis="1 0 0" damping="1" limited="true" range="-1 1" name="rail"/>
      <geom type="capsule" size="0.1" fromto="-0.1 0 0 0.1 0 0"/>
      <body>
        <joint type="hinge" axis="0 1 0" damping="1"/>
        <geom type="capsule" size="0.049" fromto="0 0 0 0.001 0 0.6"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="rail" gear="100"/></actuator>
</mujoco>
"""
_ARM = """
<mujoco>{option}
  <compiler angle="radian"/>
  <default><joint type="hinge" axis="0 0 1" armature="1" damping="1"/></default>
  <worldbody>
    <body>
      <joint name="shoulder"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0"/>
      <body pos="0.1 0 0">
        <joint name="elbow" limited="true" range="-3 3"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0"/>
        <geom type="sphere" size="0.01" pos="0.11 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="200"/><motor joint="elbow" gear="200"/></actuator>
</mujoco>
"""


class _Simulated(Bare):
    """A task whose positions and velocities MJX moves on."""

    xml: str
    control_hz: float

    def __init__(self):
        option = _OPTION.format(timestep=1 / (_SUBSTEPS * self.control_hz))
        self.mj_model = mujoco.MjModel.from_xml_string(self.xml.format(option=option))
        self._model = mjx.put_model(self.mj_model)
        self._blank = mjx.make_data(self._model)

    def _moved(self, position, velocity, control):
        """Position and velocity after some substeps."""

        def substep(data, _):
            return mjx.step(self._model, data), None

        begun = self._blank.replace(qpos=position, qvel=velocity, ctrl=control)
        data, _ = jax.lax.scan(substep, begun, length=_SUBSTEPS)
        return data.qpos, data.qvel


class InvertedPendulum(_Simulated):
    """A pole on a cart, to be kept upright; the task ends when it leans by more than 0.2 rad.

    Observation (4,): the cart's place (m), the pole's lean (rad), and their rates (per second).
    Action (1,): force, of 300 N. The reward is 1 for each of 1,000 steps that ends upright.
    """

    xml, control_hz, episode_length = _CART, 25.0, 1000
    observation_size, action_size = 4, 1

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts nearly upright and nearly at rest: every number within 0.01."""
        numbers = jax.random.uniform(key, (2, 2), minval=-0.01, maxval=0.01)
        return self._now(numbers[0], numbers[1])

    def step(self, state: State, action: Float[Array, "1"]) -> State:
        return self._now(*self._moved(*state.data, 3.0 * jnp.clip(action, -1.0, 1.0)))

    def _now(self, position, velocity) -> State:
        place, lean = position
        upright = (jnp.abs(lean) <= 0.2).astype(jnp.float32)
        cart = jnp.stack([place, jnp.zeros(())])
        tip = cart + 0.6 * jnp.stack([jnp.sin(lean), jnp.cos(lean)])
        obs = jnp.concatenate([position, velocity])
        data = (position, velocity)
        return self._state(data, obs, (cart, tip), upright, upright, done=1.0 - upright)


class Reacher(_Simulated):
    """A two-link arm that brings its fingertip to a target on the table. It never ends by itself.

    Observation (10,): cosines and sines of both angles, the target's place (m), both angular
    speeds (rad/s), and the way from target to fingertip (m). Action (2,): torques, of 200 N m. An
    idle arm gets about -10 in its 50 steps of 20 ms, and -4 is good.
    """

    xml, control_hz, episode_length = _ARM, 50.0, 50
    observation_size, action_size = 10, 2

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts nearly straight and at rest, with the target within 0.2 m of the shoulder."""
        key_angle, key_speed, key_target = jax.random.split(key, 3)
        position = jax.random.uniform(key_angle, (2,), minval=-0.1, maxval=0.1)
        velocity = jax.random.uniform(key_speed, (2,), minval=-0.005, maxval=0.005)
        share, turn = jax.random.uniform(key_target, (2,))
        direction = jnp.stack([jnp.cos(2 * jnp.pi * turn), jnp.sin(2 * jnp.pi * turn)])
        target = 0.2 * jnp.sqrt(share) * direction  # as many in each piece of the disc
        return self._now(position, velocity, target, effort=0.0)

    def step(self, state: State, action: Float[Array, "2"]) -> State:
        position, velocity, target = state.data
        action = jnp.clip(action, -1.0, 1.0)
        position, velocity = self._moved(position, velocity, action)
        return self._now(position, velocity, target, effort=jnp.sum(action**2))

    def _now(self, position, velocity, target, effort) -> State:
        first, both = position[0], position[0] + position[1]
        tip = 0.1 * jnp.stack([jnp.cos(first), jnp.sin(first)])
        tip = tip + 0.11 * jnp.stack([jnp.cos(both), jnp.sin(both)])
        distance = jnp.sqrt(jnp.sum((tip - target) ** 2))
        near = (distance < 0.02).astype(jnp.float32)
        parts = (jnp.cos(position), jnp.sin(position), target, velocity, tip - target)
        obs = jnp.concatenate(parts)
        data = (position, velocity, target)
        return self._state(data, obs, (target, tip), -distance - effort, near, done=jnp.zeros(()))
