"""Parts of a study as jobs of a cluster, by submitit (pip install 'gril-jax[cluster]').

submitit sends a job that is about to be cut off its own signal; the job is then queued again, and
goes on with its part where that was last saved.
"""

import importlib
import importlib.util
import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import ConfigError

from . import saved
from .driver import Echo
from .parts import CarryOut, command

KINDS = ("slurm", "local")
_WAIT_S = 1.0


def require_known(kind: str, options: str | None) -> dict[str, Any]:
    """The options of jobs, from KEY=VALUE with commas between; ConfigError if they are not so, or
    if submitit is not installed."""
    if kind not in KINDS:
        raise ConfigError(f"--cluster is {kind!r}, but must be one of {', '.join(KINDS)}")
    if importlib.util.find_spec("submitit") is None:
        raise ConfigError(
            "--cluster needs the package submitit, which is not installed: "
            "pip install 'gril-jax[cluster]'"
        )
    found: dict[str, Any] = {}
    for pair in filter(None, (options or "").split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise ConfigError(f"--cluster-options has {pair!r}, but must be KEY=VALUE,KEY=VALUE")
        found[key] = int(value) if value.isdecimal() else value
    return found


class Part:
    """The job of a part; submitit queues it again after `checkpoint`."""

    def __call__(self, folder: str) -> int:
        """Carries the part out; its exit code."""
        return subprocess.run(
            command(Path(folder)), env=os.environ | {"PYTHONUNBUFFERED": "1"}
        ).returncode

    def checkpoint(self, folder: str) -> Any:
        """The same job once more: the part goes on where it was last saved."""
        return importlib.import_module("submitit").helpers.DelayedSubmission(Part(), folder)


def jobs(kind: str, options: Mapping[str, Any], echo: Echo) -> CarryOut:
    """Carries parts out as jobs, one GPU each unless the options say otherwise."""

    def carry_out(left: Sequence[Path]) -> dict[Path, int]:
        if not left:
            return {}
        submitit = importlib.import_module("submitit")
        executor = submitit.AutoExecutor(folder=saved.root(left[0]) / "jobs", cluster=kind)
        usual = {
            "slurm_job_name": "gril",
            "gpus_per_node": int(kind == "slurm"),
            "timeout_min": 240,
        }
        executor.update_parameters(**usual | dict(options))
        running = {part: executor.submit(Part(), str(part)) for part in left}
        echo("jobs: " + ", ".join(job.job_id for job in running.values()))
        codes: dict[Path, int] = {}
        while len(codes) < len(running):
            time.sleep(_WAIT_S)
            for part, job in running.items():
                if part not in codes and job.done():
                    codes[part] = 1 if job.exception() is not None else int(job.result())
        return codes

    return carry_out
