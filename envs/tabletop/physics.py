"""The model of a tabletop scene, and a control step in MuJoCo MJX, of the few arrays that matter.

An episode remembers joint positions, velocities and the solver's last accelerations; the rest of
MuJoCo's data is made anew in each substep. MuJoCo Warp, several times faster on NVIDIA's GPUs and
without derivatives, can take the place of MJX's own code. Lengths are metres, masses kg.
"""

import contextlib
import importlib
import io
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.panda.model import words
from jaxtyping import Array, Float, Int

_WALL = 0.004  # half its thickness
HIDDEN = 'group="5"'  # of shapes that touch and are not painted


def box(name: str, center, half, mass: float = 0.0, more: str = "") -> str:
    """A box, by its middle and half extents."""
    label = f'name="{name}" ' if name else ""
    place = f'pos="{words(center)}" size="{words(half)}"'
    return f'<geom {label}type="box" {place} mass="{mass}" {more}/>'


def fixed(name: str, *shapes: str) -> str:
    """A body that each episode puts elsewhere and no contact moves."""
    return f'<body name="{name}" mocap="true">{"".join(shapes)}</body>'


def loose(name: str, *shapes: str, joint: str = "") -> str:
    """A body that moves freely; `joint` are further attributes of its joint."""
    return f'<body name="{name}"><joint type="free" name="{name}" {joint}/>{"".join(shapes)}</body>'


def walls(name: str, half: tuple[float, float], height: float) -> dict[str, tuple]:
    """Middles and half extents of four walls on the table, by name; `half` is the space inside."""
    (x, y), z, w = half, height / 2, _WALL
    return {
        f"{name}_front": ((x + w, 0.0, z), (w, y, z)),
        f"{name}_back": ((-x - w, 0.0, z), (w, y, z)),
        f"{name}_left": ((0.0, y + w, z), (x + 2 * w, w, z)),
        f"{name}_right": ((0.0, -y - w, z), (x + 2 * w, w, z)),
    }


def outside(half: tuple[float, float], height: float) -> tuple[float, float, float]:
    """Half extents of the box around such walls."""
    return half[0] + 2 * _WALL, half[1] + 2 * _WALL, height / 2


def wires(half: tuple[float, float], height: float, *, rows: int = 3, posts: int = 3) -> str:
    """Thin bars along such walls: a basket that one sees through."""
    (x, y), w, shapes = half, _WALL / 2, []
    for row in range(rows):
        z = w + (height - 2 * w) * row / (rows - 1)
        shapes += [box("", (0, side * y, z), (x, w, w)) for side in (-1, 1)]
        shapes += [box("", (side * x, 0, z), (w, y, w)) for side in (-1, 1)]
    for post in range(posts):
        at = -1 + 2 * post / (posts - 1)
        shapes += [box("", (at * x, s * y, height / 2), (w, w, height / 2)) for s in (-1, 1)]
        if abs(at) < 1:
            shapes += [box("", (s * x, at * y, height / 2), (w, w, height / 2)) for s in (-1, 1)]
    return "".join(shapes)


with contextlib.redirect_stdout(io.StringIO()):  # it reports on parts that are not installed
    from mujoco import mjx

TABLE = "table"
IMPLEMENTATIONS = ("jax", "warp")

_ROWS = 6  # of the solver for each contact: 4 of its pyramid, and what joints and limits need


class Additions(NamedTuple):
    """A task's additions to the arm and the table."""

    bodies: str  # MJCF; joints of free things come after the arm's, in this order
    pairs: tuple[tuple[str, str], ...]  # geoms that can touch


def build(
    scene: Additions, *, timestep: float, iterations: int, ls_iterations: int, max_contacts: int
) -> mujoco.MjModel:
    """Compiles a scene: the Panda, a table at z = 0, and the task's objects.

    Numbers are as for `task.Tabletop`, `timestep` in s; `max_contacts` is MJX's: C MuJoCo has no
    such cap. Contacts are an explicit list of pairs, all among planes, spheres, capsules and boxes.
    How stiff they are decides how many Newton iterations a friction grasp needs: with the impedance
    below 3 are enough for a scripted grasp and 2 throw the shoe away, while Playground's (0.99
    0.995 0.01) needs 5, and 8 with `impratio` 10. A held shoe of 0.25 kg creeps 1.1 mm a second
    with it (2.1 with 5 substeps), 0.2 with Playground's.
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


class Motion(NamedTuple):
    """Q positions and V velocities: the arm's nine joints, then the task's."""

    qpos: Float[Array, "Q"]  # rad, metres; a free joint has its position and quaternion
    qvel: Float[Array, "V"]
    warmstart: Float[Array, "V"]  # accelerations with which the solver begins


class Physics:
    """A compiled scene: a model of `build`, and how many of its steps are a control step.

    `impl` is one of `IMPLEMENTATIONS`: "jax" is MJX, "warp" MuJoCo Warp. There, `worlds` are the
    most environments that are stepped together. Their contacts share one table, and those that find
    no room in it are lost; Warp says so.

    Raises:
      ValueError: Warp is not installed, or the scene's servos are not as `driven` takes them.
    """

    def __init__(self, model: mujoco.MjModel, *, substeps: int, impl: str, worlds: int):
        self.mj_model, self.substeps, self._impl = model, substeps, impl
        self._driven = driven(model)
        self.dt = model.opt.timestep * substeps
        most = int(model.numeric("max_contact_points").data[0])
        room = {"naconmax": most * worlds, "njmax": _ROWS * most} if impl == "warp" else {}
        try:
            self._model = mjx.put_model(model, impl=impl)
        except RuntimeError as error:
            raise ValueError(
                f"impl is {impl!r}, which needs a package: pip install 'gril-jax[warp]' ({error})"
            ) from error
        if impl == "warp":
            self._model = _untold_of_iterations(self._model)
        self._blank = mjx.make_data(model if room else self._model, impl=impl, **room)

    def start(self, qpos: Float[Array, "Q"]) -> Motion:
        """The motion of a scene at rest."""
        return Motion(qpos, *[jnp.zeros(self.mj_model.nv)] * 2)

    def step(self, motion: Motion, aim: Float[Array, "U"], fixtures: Float[Array, "M 7"]) -> Motion:
        """Advances one control step in which the servos hold their aims.

        Fixtures are the position and quaternion of each mocap body, which no contact moves.
        """

        def substep(motion, _):
            data = self._blank.replace(
                qpos=motion.qpos, qvel=motion.qvel, qacc_warmstart=motion.warmstart, ctrl=aim,
                mocap_pos=fixtures[:, :3], mocap_quat=fixtures[:, 3:],
            )  # fmt: skip
            model, at = self._model, self._driven
            if self._impl != "warp":
                model = constant_where_saturated(model, at, motion.qpos, motion.qvel, aim)
            data = mjx.step(model, data)
            return Motion(data.qpos, data.qvel, data.qacc_warmstart), None

        # On graphics processors products may otherwise be rounded to ten bits.
        with jax.default_matmul_precision("highest"):
            return jax.lax.scan(substep, motion, length=self.substeps)[0]


def _untold_of_iterations(model: mjx.Model) -> mjx.Model:
    """Warp's model without its warning that the iteration limit stopped the solver.

    The limit is low on purpose, and thousands of environments would print the warning in each step.
    The warning that a contact found no room stays.
    """
    kinds = importlib.import_module("mujoco.mjx.third_party.mujoco_warp").OverflowType
    told = model.opt._impl.warn_overflow & ~(kinds.ITERATIONS | kinds.LS_ITERATIONS)
    return model.tree_replace({"opt._impl.warn_overflow": int(told)})


def driven(model: mujoco.MjModel) -> tuple[Int[np.ndarray, "U"], Int[np.ndarray, "U"]]:
    """Indices of the joints that U servos each drive, among positions and among velocities.

    Raises:
      ValueError: an actuator drives something else, by a gear, or has no limit to its force.
    """
    joint = model.actuator_trnid[:, 0]
    of_joints = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    direct = (model.actuator_gear[:, 0] == 1).all()
    if not (of_joints and direct and model.actuator_forcelimited.all()):
        raise ValueError("each actuator must drive a joint without a gear, its force limited")
    return model.jnt_qposadr[joint], model.jnt_dofadr[joint]


def constant_where_saturated(
    model, at, qpos: Float[Array, "Q"], qvel: Float[Array, "V"], aim: Float[Array, "U"]
):
    """The `mjx.Model` for a substep from `qpos` and `qvel`, its saturated servos constant forces.

    The integrator "implicitfast" takes the damping of a servo (its force falls by kv for each
    rad/s) as implicit. C MuJoCo leaves it out for a servo at the limit of its force, which does not
    change with the speed then, and since February 2026 MuJoCo Warp does (its pull request 1149);
    MJX (3.17) does not, so that its arm is too slow whenever it is driven hard. `at` are the joints
    that `driven` returns, `aim` the servos' aims.
    """
    low, high = model.actuator_ctrlrange.T
    control = jnp.where(model.actuator_ctrllimited, jnp.clip(aim, low, high), aim)
    gain, bias = model.actuator_gainprm, model.actuator_biasprm
    force = gain[:, 0] * control + bias[:, 0]
    force += bias[:, 1] * qpos[at[0]] + bias[:, 2] * qvel[at[1]]
    least, most = model.actuator_forcerange.T
    saturated = ((force <= least) | (force >= most))[:, None]
    constant = jnp.zeros_like(bias).at[:, 0].set(jnp.clip(force, least, most))
    return model.replace(
        actuator_gainprm=jnp.where(saturated, 0.0, gain),
        actuator_biasprm=jnp.where(saturated, constant, bias),
    )
