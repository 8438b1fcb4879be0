"""Pictures of a tabletop scene with per-pixel object ids, rendered without a display.

OpenGL comes through EGL or OSMesa; the environment variable MUJOCO_GL may name one. What is painted
is what a graph has: each thing is the box that the task says it is, unless it is a ball or made of
several, and each robot node likewise. The rest of the arm and the table are scenery.
"""

import copy
import importlib
import os
from typing import NamedTuple

import jax
import mujoco
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.tabletop.environment import Tabletop
from jaxtyping import Float, Int8, UInt8

from .boxes import Boxes, Camera

_BACKENDS = ("egl", "osmesa")
_FLAGS = mujoco.mjtRndFlag
_BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
_BALL = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_UNSEEN = 5  # a group of geoms that is not painted
_SCENERY = -1
_TABLE, _ARM = (0.62, 0.5, 0.38), (0.93, 0.93, 0.94)
_COLOURS = (
    (0.25, 0.25, 0.27), (0.25, 0.25, 0.27), (0.8, 0.8, 0.82), (0.5, 0.53, 0.58), (0.68, 0.7, 0.74),
    (0.42, 0.24, 0.14), (0.55, 0.34, 0.2), (0.3, 0.5, 0.32), (0.55, 0.35, 0.6),
)  # fmt: skip


class Picture(NamedTuple):
    """One state as the camera sees it; the first row is the top."""

    frame: UInt8[np.ndarray, "P P 3"]  # RGB
    thing: Int8[np.ndarray, "P P"]  # index of the object that a pixel shows; -1 scenery


class Renderer:
    """Renders states of one environment as square pictures.

    Objects find their shapes by name: those of "shoe A" are in the body "shoe_a". The start is any
    state of the environment; only where boxes lie in their bodies is read.

    Raises:
      ValueError: the size is out of range, or no body is named after an object.
      RuntimeError: there is no OpenGL on this machine.
    """

    def __init__(self, env: Tabletop, start: State, *, pixels: int = 256):
        if not 16 <= pixels <= 2048:
            raise ValueError(f"pixels is {pixels}, but must be from 16 to 2048")
        self.pixels = pixels
        self._gl = _open(pixels)
        self._model = copy.copy(env.physics.mj_model)
        self._data = mujoco.MjData(self._model)
        self._owner = _dress(self._model, self._data, env, start)
        self._camera = _set_view(self._model, env.camera, pixels)
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = [group != _UNSEEN for group in range(6)]
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom)
        self._scene.flags[[_FLAGS.mjRND_SHADOW.value, _FLAGS.mjRND_REFLECTION.value]] = False
        self._gl.make_current()
        self._target = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._target)

    def picture(self, qpos: Float[np.ndarray, "Q"], fixtures: Float[np.ndarray, "M 7"]) -> Picture:
        """Renders one state, given its joint positions and the poses of what stands still."""
        frame = self.frame(qpos, fixtures)
        segmented = [_FLAGS.mjRND_SEGMENT.value, _FLAGS.mjRND_IDCOLOR.value]
        self._scene.flags[segmented] = True
        codes = self._read()
        self._scene.flags[segmented] = False
        number = codes[:, :, 0].astype(np.int32) + 256 * codes[:, :, 1].astype(np.int32)
        # What is painted first has number 1; 0 is the background.
        thing = np.full(self._model.ngeom + 1, _SCENERY, np.int8)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            thing[geom.segid + 1] = self._owner[geom.objid]
        return Picture(frame, thing[number])

    def frame(
        self, qpos: Float[np.ndarray, "Q"], fixtures: Float[np.ndarray, "M 7"]
    ) -> UInt8[np.ndarray, "P P 3"]:
        """Renders the colours alone of one state; arguments as for `picture`."""
        self._gl.make_current()
        _put(self._model, self._data, qpos, fixtures)
        mujoco.mjv_updateScene(
            self._model, self._data, self._options, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        return self._read()

    def _read(self) -> UInt8[np.ndarray, "P P 3"]:
        pixels = np.empty((self.pixels, self.pixels, 3), np.uint8)
        area = mujoco.MjrRect(0, 0, self.pixels, self.pixels)
        mujoco.mjr_render(area, self._scene, self._target)
        mujoco.mjr_readPixels(pixels, None, area, self._target)
        return np.ascontiguousarray(pixels[::-1])

    def close(self) -> None:
        """Frees the memory."""
        self._gl.make_current()
        self._target.free()
        self._gl.free()


def _open(pixels: int):
    """An OpenGL context from the first backend that works."""
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    platform, reasons = os.environ.get("PYOPENGL_PLATFORM"), []
    for name in (wanted,) if wanted in _BACKENDS else _BACKENDS:
        try:
            # Which of them can be imported depends on the machine's own libraries.
            context = importlib.import_module(f"mujoco.{name}").GLContext(pixels, pixels)
            context.make_current()
        except (ImportError, AttributeError, OSError, RuntimeError) as error:
            reasons.append(f"{name}: {type(error).__name__}")
            if platform is None:  # MuJoCo has set it for the backend that failed
                os.environ.pop("PYOPENGL_PLATFORM", None)
        else:
            return context
    raise RuntimeError(
        "no OpenGL works here without a display, so nothing can be painted; install libegl1 or "
        f"libosmesa6, or name the one to use in MUJOCO_GL ({'; '.join(reasons)})"
    )


def _put(model: mujoco.MjModel, data: mujoco.MjData, qpos, fixtures: np.ndarray) -> None:
    """Puts all bodies where these joints and fixtures have them."""
    data.qpos[:] = qpos
    data.mocap_pos[:], data.mocap_quat[:] = np.split(fixtures, [3], axis=1)
    mujoco.mj_kinematics(model, data)


def _dress(model: mujoco.MjModel, data: mujoco.MjData, env: Tabletop, start: State) -> np.ndarray:
    """Turns shapes into coloured boxes of the objects, balls apart; returns each geom's object."""
    _put(model, data, start.data.motion.qpos, np.asarray(start.data.fixtures))
    boxes = jax.device_get(jax.jit(env.world_boxes)(start.data))
    owner = np.full(model.ngeom, _SCENERY, np.int8)
    colours = (*_COLOURS[:3], *(env.task.colours or _COLOURS[3:]))  # three parts of the robot
    model.geom_rgba[:] = (*_ARM, 1)
    model.geom_rgba[model.geom_bodyid == 0] = (*_TABLE, 1)
    for index, name in enumerate(env.classes):
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name.lower().replace(" ", "_"))
        if body < 0:
            raise ValueError(f"no body of the scene is named after {name!r}")
        shapes = np.flatnonzero(model.geom_bodyid == body)
        owner[shapes] = index
        model.geom_rgba[shapes] = (*colours[index % len(colours)], 1)
        flat = shapes[model.geom_type[shapes] == _BOX]
        a_ball = len(shapes) == 1 and model.geom_type[shapes[0]] == _BALL
        if len(flat) < 2 and not a_ball:
            only = int(flat[0]) if len(flat) else int(shapes[0])
            model.geom_group[shapes[shapes != only]] = _UNSEEN
            _make_box(model, data, only, body, Boxes(*(x[index] for x in boxes)))
    return owner


def _make_box(model, data, geom: int, body: int, box: Boxes) -> None:
    """Gives a geom the position and shape of a box in space."""
    turn = data.xmat[body].reshape(3, 3)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, (turn.T @ box.rotation).astype(np.float64).reshape(9))
    model.geom_type[geom] = _BOX
    model.geom_size[geom] = box.half
    model.geom_pos[geom] = turn.T @ (box.position - data.xpos[body])
    model.geom_quat[geom] = quaternion
    model.geom_sameframe[geom] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE


def _set_view(model: mujoco.MjModel, camera: Camera, pixels: int) -> mujoco.MjvCamera:
    model.vis.global_.offwidth = model.vis.global_.offheight = pixels
    model.vis.quality.offsamples = 0  # rough edges, but without a graphics card twice the speed
    model.vis.global_.fovy = float(np.degrees(camera.field))
    model.vis.headlight.ambient[:] = 0.45
    model.vis.headlight.diffuse[:] = 0.5
    model.vis.headlight.specular[:] = 0.0
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FREE
    way = np.subtract(camera.target, camera.place)
    view.distance = np.linalg.norm(way)
    view.azimuth = np.degrees(np.arctan2(way[1], way[0]))
    view.elevation = np.degrees(np.arcsin(way[2] / view.distance))
    view.lookat[:] = camera.target
    return view
