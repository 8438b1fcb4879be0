"""A launch of the kernel over all episodes: on a CPU, where Warp has one thread, a few at once.

Episodes do not depend on each other, so neither do the numbers on how they are shared out.
"""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import no_type_check

import jax
import warp as wp

from .device import Vec3s
from .program import OUTPUTS, Strengths, control_step

_LEAST = 64  # episodes that are worth a thread
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
        sizes: wp.array3d(dtype=float), strengths: wp.array(dtype=Strengths), commands: Vec3s,
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
