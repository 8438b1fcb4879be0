"""MJCF of a tabletop scene: the Panda, a table at z = 0, and the task's objects.

Contacts are an explicit list of pairs, so that nothing is looked for that does not matter, and all
of them are among planes, spheres, capsules and boxes. How stiff they are decides how many Newton
iterations a friction grasp needs: with the impedance below 3 are enough for a scripted grasp and 2
throw the shoe away, while Playground's (0.99 0.995 0.01) needs 5, and 8 with `impratio` 10. A held
shoe of 0.25 kg creeps 1.1 mm a second with it (2.1 with 5 substeps), 0.2 with Playground's.
"""

from typing import NamedTuple

import mujoco
from gril_jax.envs.panda import model as panda_model

TABLE = "table"


class Scene(NamedTuple):
    """A task's additions to the arm and the table."""

    bodies: str  # MJCF; joints of free things come after the arm's, in this order
    pairs: tuple[tuple[str, str], ...]  # geoms that can touch


def build(
    scene: Scene, *, timestep: float, iterations: int, ls_iterations: int, max_contacts: int
) -> mujoco.MjModel:
    """Compiles a scene; numbers are as for `task.Tabletop`, `timestep` in s.

    `max_contacts` is MJX's: C MuJoCo has no such cap.
    """
    friction = 'condim="3" friction="1.0 1.0 0.005 0.0001 0.0001"'
    pairs = "".join(f'<pair geom1="{a}" geom2="{b}" {friction}/>' for a, b in scene.pairs)
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="tabletop">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{timestep}" integrator="implicitfast" solver="Newton" cone="pyramidal"
          iterations="{iterations}" ls_iterations="{ls_iterations}">
    <flag eulerdamp="disable"/>
  </option>
  <custom><numeric name="max_contact_points" data="{max_contacts}"/></custom>
  <default>
    <geom contype="0" conaffinity="0"/>
    <pair solref="0.01 1" solimp="0.95 0.99 0.005"/>
  </default>
  <worldbody>
    <geom name="{TABLE}" type="plane" size="1 1 0.1"/>
    {panda_model.body()}
    {scene.bodies}
  </worldbody>
  <contact>{pairs}</contact>
  <equality>{panda_model.EQUALITY}</equality>
  <actuator>{panda_model.ACTUATORS}</actuator>
</mujoco>""")
