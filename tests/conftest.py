"""Set before any test imports JAX: the suite is for the CPU, whatever else a machine has."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the suite's time is LLVM's; without its optimisations programs compile a quarter faster.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
