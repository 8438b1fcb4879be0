"""One control step of a tabletop scene in MuJoCo MJX, from and to the few arrays that matter.

What an episode must remember is joint positions and velocities and the solver's last accelerations;
the rest of MuJoCo's data is made anew in each substep, which spares the memory of thousands of
environments.

On CPUs jaxlib 0.10's newer code generator computes the arm's kinematics thousands of times too
slowly: it repeats each link's chain for each number that depends on it. There, set XLA_FLAGS or
`jax.jit`'s compiler option "xla_cpu_use_fusion_emitters" to false.

MuJoCo Warp, where it is installed, can take the place of MJX's own JAX code. A step of either is
that of C MuJoCo (`saturated_servos` says what MJX needs for it); they keep other contacts when
there are many. Warp is written for NVIDIA GPUs, where it is several times faster, runs on a CPU
too, and has no derivatives.
"""

import contextlib
import importlib
import io
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
from gril_jax.envs.panda.saturated_servos import constant_where_saturated, driven
from jaxtyping import Array, Float

with contextlib.redirect_stdout(io.StringIO()):  # it reports on parts that are not installed
    from mujoco import mjx

IMPLEMENTATIONS = ("jax", "warp")

_ROWS = 6  # of the solver for each contact: 4 of its pyramid, and what joints and limits need


class Motion(NamedTuple):
    """Q positions and V velocities: the arm's nine joints, then the task's."""

    qpos: Float[Array, "Q"]  # rad, metres; a free joint has its position and quaternion
    qvel: Float[Array, "V"]
    warmstart: Float[Array, "V"]  # accelerations with which the solver begins


class Physics:
    """A compiled scene: a model of `model.build`, and how many of its steps are a control step.

    `impl` is one of `IMPLEMENTATIONS`: "jax" is MJX, "warp" MuJoCo Warp. There, `worlds` are the
    most environments that are stepped together. Their contacts share one table, and those that find
    no room in it are lost; Warp says so.

    Raises:
      ValueError: Warp is not installed, or the scene's servos are not as `saturated_servos.driven`
        takes them.
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
    """Warp's model without the warning that it prints whenever the iteration limit cuts a solve.

    They are so few on purpose, and thousands of environments would say so in each step. What says
    that a contact found no room is left.
    """
    kinds = importlib.import_module("mujoco.mjx.third_party.mujoco_warp").OverflowType
    told = model.opt._impl.warn_overflow & ~(kinds.ITERATIONS | kinds.LS_ITERATIONS)
    return model.tree_replace({"opt._impl.warn_overflow": int(told)})
