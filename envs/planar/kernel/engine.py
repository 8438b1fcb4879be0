"""The kernel behind the interface of `physics.Physics`, inside JAX's programs.

Hot is `step` alone: the rest is the XLA engine's, of which this one computes the same numbers but
for rounding. On a CPU, where Warp has one thread, a few launches share the episodes, which do not
depend on each other.
"""

import contextlib
import functools
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import no_type_check

import jax
import jax.numpy as jnp
import warp as wp
from gril_jax.envs.planar.impulses import LEFT
from gril_jax.envs.planar.joints import Command, Strengths
from gril_jax.envs.planar.physics import BLOCK_MASS, Physics
from gril_jax.envs.planar.shapes import BlockShape
from jaxtyping import Array, Float

from .bodies import Vec3s
from .fingers import NONE, PINS, PIVOTS
from .program import OUTPUTS, control_step
from .program import Strengths as KernelStrengths

_LEAST = 64  # least episodes of a thread
_BLOCK = 64  # threads of a GPU's block


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


_POOL = ThreadPoolExecutor(_cores(), "planar-kernel")


def _shares(lanes: int) -> list[slice]:
    """Consecutive lanes of about the same number, for each thread."""
    count = max(1, min(_cores(), lanes // _LEAST))
    bounds = [lanes * i // count for i in range(count + 1)]
    return [slice(*pair) for pair in itertools.pairwise(bounds)]


def _launch(kernel: wp.Kernel, arguments: list) -> None:
    """Launches the kernel with all arguments, of which arrays have a lane for each thread."""
    inputs, outputs = arguments[:-OUTPUTS], arguments[-OUTPUTS:]
    lanes = outputs[0].shape[0]
    if not outputs[0].device.is_cpu:
        wp.launch(kernel, lanes, inputs=inputs, outputs=outputs, block_dim=_BLOCK)
        return

    def part(share: slice) -> None:
        own = lambda x: x[share] if isinstance(x, wp.array) else x  # noqa: E731
        some = [own(x) for x in inputs], [own(x) for x in outputs]
        wp.launch(kernel, share.stop - share.start, *some, device="cpu")

    shares = _shares(lanes)
    list(_POOL.map(part, shares)) if len(shares) > 1 else part(shares[0])


def callable_step(robot: str, blocks: int, kind: int) -> Callable:
    """The kernel `control_step` for these, to be called in JAX's programs."""
    kernel = control_step(robot, blocks, kind)

    @no_type_check
    def planar_step(
        pose: wp.array2d(dtype=wp.vec3), velocity: wp.array2d(dtype=wp.vec3),
        memory: wp.array2d(dtype=float), directions: wp.array3d(dtype=wp.vec2),
        corners: wp.array3d(dtype=wp.vec2), rims: wp.array3d(dtype=wp.vec2),
        sizes: wp.array3d(dtype=float), strengths: wp.array(dtype=KernelStrengths), commands: Vec3s,
        inverse_mass: float, arena: float, dt: float, ahead: float, rate: float, substeps: int,
        iterations: int, new_pose: wp.array2d(dtype=wp.vec3),
        new_velocity: wp.array2d(dtype=wp.vec3), new_memory: wp.array2d(dtype=float),
    ):  # fmt: skip
        _launch(kernel, [
            pose, velocity, memory, directions, corners, rims, sizes, strengths, commands,
            inverse_mass, arena, dt, ahead, rate, substeps, iterations, new_pose, new_velocity,
            new_memory,
        ])  # fmt: skip

    call = wp.jax_callable(planar_step, num_outputs=OUTPUTS)

    def traced(*arguments, **keywords):
        # Now, since a GPU loads no code while its launches are recorded as a graph.
        for device in jax.local_devices():
            wp.load_module(kernel.module, wp.device_from_jax(device), block_dim=_BLOCK)
        return call(*arguments, **keywords)

    return traced


class KernelPhysics:
    """The engine `physics` as a kernel; `pins` says that MAGICAL's pins hold the fingers."""

    def __init__(self, physics: Physics, *, pins: bool):
        self.physics, self.dt = physics, physics.dt
        wp.config.log_level = wp.LOG_WARNING  # or Warp reports on each kernel
        with _without_stderr():  # where there is no GPU, Warp's library says so
            _begin()
        kind = int(PINS if pins else PIVOTS) if physics.robot.has_fingers else int(NONE)
        self._call = callable_step(physics.robot.name, physics.num_blocks, kind)
        self._memory = physics.rest().size

    def rest(self) -> Float[Array, "I"]:
        """The memory of a scene in which nothing has touched yet."""
        return self.physics.rest()

    # By itself, so that programs which share this object trace it once.
    @functools.partial(jax.jit, static_argnums=0)
    def step(
        self,
        pose: Float[Array, "E 3"],
        velocity: Float[Array, "E 3"],
        memory: Float[Array, "I"],
        shapes: BlockShape,
        strengths: Strengths,
        command: Command,
    ) -> tuple[Float[Array, "E 3"], Float[Array, "E 3"], Float[Array, "I"]]:
        """Poses, velocities and memory a control step later, as `Physics.step`."""
        of, dt = self.physics, self.dt
        lane = [pose, velocity, memory, *_fields(shapes, BLOCK_MASS / of.block_mass)]
        lane += [jnp.stack([jnp.asarray(x, jnp.float32) for x in f]) for f in (strengths, command)]
        scalars = 1 / of.block_mass, of.arena, dt, of.ahead, (1.0 - LEFT**dt) / dt
        dims = {
            "new_pose": (1, len(pose)),
            "new_velocity": (1, len(pose)),
            "new_memory": (1, self._memory),
        }

        def call(*lane):
            one = (x[None] for x in lane)
            return self._call(*one, *scalars, of.substeps, of.iterations, output_dims=dims)

        return tuple(x[0] for x in _without_gradients(call, *lane))

    def settle(self, *args) -> Float[Array, "I"]:
        """The memory of a scene that a command has just brought here, as `Physics.settle`."""
        return self.physics.settle(*args)

    def clearance(self, pose: Float[Array, "E 3"], shapes: BlockShape) -> Float[Array, ""]:
        """Gap between the robot and the nearest block or wall, as `Physics.clearance`."""
        return self.physics.clearance(pose, shapes)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _without_gradients(call: Callable, *arrays: Array) -> tuple[Array, ...]:
    """The arrays that the call returns."""
    return tuple(call(*arrays))


@_without_gradients.defjvp
def _refuse(*_):
    raise ValueError("engine 'kernel' has no gradients: make the task with engine 'impulse'")


def _begin() -> None:
    """Starts Warp, with a temporary cache where its own cannot be written."""
    try:
        wp.init()
    except OSError:
        wp.config.kernel_cache_dir = _scratch().name
        wp.init()


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory:
    """A folder that leaves with the process."""
    return tempfile.TemporaryDirectory(prefix="gril-warp-")


@contextlib.contextmanager
def _without_stderr() -> Iterator[None]:
    """Keeps what libraries print out of the process's standard error."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _fields(shapes: BlockShape, lightness: float) -> list[Array]:
    """Directions (B, 5, 2), corners (B, 5, 2), rims (B, 3, 2) and sizes (B, 3)."""
    pairs = lambda v: jnp.stack([v.x, v.y], axis=-1)  # noqa: E731
    corners = jnp.swapaxes(pairs(shapes.corners), 0, 1)
    rims = jnp.stack([pairs(v) for v in (shapes.rim_start, shapes.rim_end, shapes.rim_out)], 1)
    reach = jnp.maximum(jnp.sqrt((corners**2).sum(-1).max(-1)) + shapes.radius, 0.0)
    sizes = jnp.stack([shapes.radius, shapes.inverse_inertia * lightness, reach], axis=1)
    return [jnp.swapaxes(pairs(shapes.directions), 0, 1), corners, rims, sizes]
