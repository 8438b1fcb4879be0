"""Set before any test imports JAX: the suite is for the CPU, whatever else a machine has."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")
