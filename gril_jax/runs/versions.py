"""versions.json: what a run was made with. No clock is in it; see `gril_jax.runs.times`."""

import platform
import shlex
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import Any

# What the numbers of a run can depend on; `gril doctor` shows the same list.
PACKAGES = (
    "gril-jax", "jax", "jaxlib", "flax", "optax", "jraph", "mujoco", "mujoco-mjx", "brax",
    "orbax-checkpoint", "warp-lang", "numpy", "scipy", "opencv-python-headless", "av",
)  # fmt: skip


def versions(device: str, command: Sequence[str] | None) -> dict[str, Any]:
    """The contents of the file of a new run; the command is `sys.argv` where None."""
    return {
        "packages": package_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "device": device,
        "command": shlex.join(sys.argv if command is None else command),
    }


def package_versions() -> dict[str, str]:
    """The installed version of each package in `PACKAGES`, or "missing"."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found
