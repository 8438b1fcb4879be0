"""Finds the other processes of a job, from the environment, before JAX is imported.

    COORDINATOR_ADDRESS=job-0.job:1234 NUM_PROCESSES=4 PROCESS_ID=2 gril sweep ... --distributed

Under SLURM none of the three is needed: JAX reads SLURM's own variables, and takes one process a
GPU. JAX is not imported here.
"""

from collections.abc import Mapping
from typing import Any

from gril_jax.errors import ConfigError

_NAMES = ("COORDINATOR_ADDRESS", "NUM_PROCESSES", "PROCESS_ID")
_SLURM = ("SLURM_JOB_ID", "SLURM_NTASKS", "SLURM_PROCID")


def cluster_of(environment: Mapping[str, str]) -> dict[str, Any]:
    """Arguments of `jax.distributed.initialize` from environment variables; none under SLURM, which
    JAX asks itself. ConfigError if they describe no job, or half of one, or do not fit."""
    given = [name for name in _NAMES if environment.get(name)]
    if not given:
        if all(environment.get(name) for name in _SLURM):
            return {}
        raise ConfigError(
            "--distributed finds no job: start it by srun, or set COORDINATOR_ADDRESS (HOST:PORT), "
            "NUM_PROCESSES and PROCESS_ID"
        )
    for name in _NAMES:
        if name not in given:
            raise ConfigError(f"{given[0]} is set, but {name} is not: set {', '.join(_NAMES)}")
    address = environment["COORDINATOR_ADDRESS"]
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():
        raise ConfigError(f"COORDINATOR_ADDRESS is {address!r}, but must be HOST:PORT")
    for name in _NAMES[1:]:
        if not environment[name].isdecimal():
            raise ConfigError(f"{name} is {environment[name]!r}, but must be a whole number")
    count, index = int(environment["NUM_PROCESSES"]), int(environment["PROCESS_ID"])
    if index >= count:
        raise ConfigError(
            f"PROCESS_ID is {index}, but must be less than NUM_PROCESSES, which is {count}"
        )
    return {
        "coordinator_address": address,
        "num_processes": count,
        "process_id": index,
        "cluster_detection_method": "deactivate",  # or it would leave us one GPU
    }
