"""Compiles the project's large programs, with options that suit the device.

    program = compiled(jax.jit(f).lower(x))

On a CPU LLVM's first level of optimisation in place of its third saves up to a quarter of the
compiler's time: 14 s in place of 19 for an encoder's training. The programs wait for memory more
than for instructions, and are as fast. On a GPU XLA takes longest to choose what to fuse, and to
try out kernels of each product of matrices. Without both an encoder's training is compiled in 1.5 s
in place of 7, and its updates take three times as long (H200, JAX 0.11).
"""

from typing import Any

import jax

# On a GPU the kernels that XLA tries out have to be compared, too, as they are by default. With
# xla_gpu_autotune_level 2, which times them alone, all 15 rewards that learned in 16,000 steps on
# one H200 diverged, and none on another. XIRL's programs then compiled in 40 s in place of 180.
_OPTIONS: dict[str, dict[str, Any]] = {"cpu": {"xla_backend_optimization_level": 1}}
_BRIEF: dict[str, dict[str, Any]] = _OPTIONS | {
    "gpu": {
        "xla_disable_hlo_passes": "priority-fusion",
        "xla_gpu_autotune_level": 0,
        "xla_gpu_enable_triton_gemm": False,
    }
}


def compiled(lowered: jax.stages.Lowered, *, brief: bool = False) -> jax.stages.Compiled:
    """Compiles a program for JAX's default devices. A brief one runs for seconds at most, so fast
    compilation matters more than fast execution."""
    options = _BRIEF if brief else _OPTIONS
    return lowered.compile(compiler_options=options.get(jax.default_backend()))
