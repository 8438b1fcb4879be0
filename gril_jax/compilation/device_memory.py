"""How much memory the devices have."""

from pathlib import Path
from typing import Any

__all__ = ["available_bytes"]


def available_bytes(device: Any) -> int | None:
    """Memory of a device that a program may use; None where the platform does not tell.

    Several CPU devices, as `--xla_force_host_platform_device_count` makes them, share that of the
    machine evenly. The device is one of this process.
    """
    if device.platform == "cpu":
        try:
            lines = Path("/proc/meminfo").read_text().splitlines()
        except OSError:
            return None
        kilobytes = next(int(x.split()[1]) for x in lines if x.startswith("MemAvailable"))
        return 1024 * kilobytes // device.client.local_device_count()
    return (device.memory_stats() or {}).get("bytes_limit")
