"""Compiles the project's large programs, with options that suit the device.

    program = compiled(jax.jit(f).lower(x))

LLVM works on the code between matrix products and sorts, which waits for memory more than for
instructions. On a CPU its first level of optimisation in place of its third saves up to a quarter
of the compiler's seconds: 14 in place of 19 for an encoder's training, 3.4 in place of 4.2 for PPO
on a pendulum, 39 in place of 47 for a task of MJX, next to none for the planar tasks. The programs
are as fast, as far as they were timed: all of these but MJX's.

On a GPU XLA takes longest over choosing what to fuse, and over trying out kernels of each product
of matrices. Without both an encoder's training is compiled in 1.5 s in place of 7, or in 6 in place
of 16 with displaced copies, and its updates take three times as long (1.1 ms in place of 0.35, or
3.3 in place of 1.0; one H200, JAX 0.11). So brief programs do without.
"""

from typing import Any

import jax

_OPTIONS: dict[str, dict[str, Any]] = {"cpu": {"xla_backend_optimization_level": 1}}
_BRIEF: dict[str, dict[str, Any]] = _OPTIONS | {
    "gpu": {
        "xla_disable_hlo_passes": "priority-fusion",
        "xla_gpu_autotune_level": 0,
        "xla_gpu_enable_triton_gemm": False,
    }
}


def compiled(lowered: jax.stages.Lowered, *, brief: bool = False) -> jax.stages.Compiled:
    """Compiles a program for JAX's default devices; a brief one runs for seconds at most, so that
    to compile it quickly is worth more than to run it fast."""
    options = _BRIEF if brief else _OPTIONS
    return lowered.compile(compiler_options=options.get(jax.default_backend()))
