"""Set before any test imports JAX: the suite is for the CPU, whatever else a machine has."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the time goes to compiling: at a lower level of optimisation it is a sixth less.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")
