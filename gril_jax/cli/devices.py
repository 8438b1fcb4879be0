"""The devices that the processes of a sweep get, one each."""

import os
import subprocess

from gril_jax.errors import ConfigError


def slots(devices: str | None) -> list[str | None]:
    """The device of each process, as CUDA_VISIBLE_DEVICES has it: all GPUs, or the first N; a
    single None without a GPU, or N of them. ConfigError for more than there are."""
    given = os.environ.get("CUDA_VISIBLE_DEVICES")
    known = [one for one in (given or "").split(",") if one] if given is not None else _gpus()
    if os.environ.get("JAX_PLATFORMS", "").startswith("cpu"):
        known = []
    if devices in (None, "all"):
        return known if len(known) > 1 else [None]
    if not devices.isdecimal() or not int(devices):
        raise ConfigError(f"--devices is {devices!r}, but must be all or a number of at least 1")
    if known and int(devices) > len(known):
        raise ConfigError(f"--devices is {devices}, but this machine has {len(known)} GPUs")
    return known[: int(devices)] or [None] * int(devices)


def _gpus() -> list[str]:
    try:
        found = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return []
    cards = [line for line in found.stdout.splitlines() if line.startswith("GPU ")]
    return [str(number) for number, _ in enumerate(cards)]
