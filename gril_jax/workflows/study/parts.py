"""A study in parts: processes or jobs that each make some of its rows, on a device of their own.

    RUN/parts/000/      a run like any other, which `gril sweep --resume` goes on with

The parent computes nothing: it shares out the work, waits, and joins what the parts have found.
"""

import collections
import importlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.runs import reading, run_dir
from gril_jax.runs.interrupt import Interrupted, noticed

from . import driver, results, saved
from .driver import Echo
from .rewards import reward_key
from .saved import Plan, Work, learns

LOG = "log.txt"  # in a part's folder: what its process said
_WAIT_S = 0.2
# A control step whose reward draws a picture, in steps whose reward reads boxes; on an H100.
_PICTURE_STEPS = 12

# From the parts' folders to the exit code of each one's process.
CarryOut = Callable[[Sequence[Path]], Mapping[Path, int]]


def make(
    plan: Plan, count: int, carry_out: CarryOut, *, resume: Path | None = None, echo: Echo = print
) -> int:
    """Makes a study in so many parts, or what is left of the one in the folder `resume`; the exit
    code, 1 if a row failed. The plan's work may be more than the run has had so far."""
    driver.require_possible(plan, plan.runs, new=resume is None)
    opened = {"device": f"{count} processes", "experiment": saved.EXPERIMENT}
    if resume is None:
        first = partial(saved.write, plan=plan._replace(in_parts=True))
        run = run_dir.create_or_resume(plan.config, None, **opened, first=first)
    else:
        run = run_dir.resume(resume)
    with run:
        saved.write_rows(run.path, plan)
        begun = saved.parts(run.path)
        missing = _missing(plan, run.path)
        for number, work in enumerate(split(plan._replace(work=missing), count), len(begun)):
            _begin(run.path / "parts" / f"{number:03}", plan._replace(work=work, in_parts=False))
        left = saved.left(run.path)
        echo(f"writing to {run.path}: {len(left)} parts")
        codes = carry_out(left)
        failed = _failed(run.path, codes)
        counts = collections.Counter[str]()
        for folder in (run.path, *saved.parts(run.path)):
            if (folder / "results.json").is_file():
                counts.update(reading.read_results(folder))
        return driver.finish(run, failed, dict(counts), echo)


def split(plan: Plan, count: int) -> list[dict[str, list[int]]]:
    """The work in at most so many parts with about as many steps each.

    Rows with the same reward, and the seeds of a row, are together where they can be."""
    groups: dict[Hashable, int] = {}
    place = {}
    for name in plan.work:
        config = plan.rows[name]
        group = reward_key(config) if learns(config) else name
        place[name] = groups.setdefault(group, len(groups))

    def steps(config: RunConfig) -> int:
        trained = getattr(config, config.run.algorithm).num_timesteps
        each = _PICTURE_STEPS if learns(config) and config.encoder.kind == "pixels" else 1
        return each * (trained if plan.study.policies else config.pretrain.steps)

    runs = [(name, seed) for name, seeds in plan.work.items() for seed in seeds]
    runs.sort(key=lambda run: (place[run[0]], run[1]))
    weights = [steps(plan.rows[name]) for name, _ in runs]
    count, done = min(count, len(runs)), 0
    parts: list[dict[str, list[int]]] = []
    for number, ((name, seed), weight) in enumerate(zip(runs, weights, strict=True)):
        due = int((done + weight / 2) / sum(weights) * count)
        due = max(due, count - (len(runs) - number))  # a run at least for each part that is left
        if due >= len(parts):
            parts.append({})
        parts[-1].setdefault(name, []).append(seed)
        done += weight
    return parts


def _missing(plan: Plan, folder: Path) -> Work:
    """The work that neither the run itself nor any of its parts has."""
    plans = [saved.read(one) for one in (folder, *saved.parts(folder))]
    has = [one.work for one in plans if not one.in_parts]
    left = {
        name: [seed for seed in seeds if not any(seed in one.get(name, ()) for one in has)]
        for name, seeds in plan.work.items()
    }
    return {name: seeds for name, seeds in left.items() if seeds}


def _begin(folder: Path, plan: Plan) -> None:
    """Creates the run of a part, which a process then goes on with."""
    shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed here
    opened = {"device": "a process of its own", "experiment": saved.EXPERIMENT}
    run_dir.create(folder, plan.config, **opened, first=partial(saved.write, plan=plan)).close()


def _failed(folder: Path, codes: Mapping[Path, int]) -> dict[int, str]:
    """The rows of the parts that failed, and of those whose process has died."""
    found, failed = results.read(folder), {}
    done = "env_steps" if found.plan.study.policies else "tau"
    complete = {(line["row"], line["seed"]) for line in found.lines if done in line}
    dead = {part for part, code in codes.items() if code and part in saved.left(folder)}
    for part in saved.parts(folder):  # what the run itself has noted is of an earlier try
        own, noted = saved.read(part), reading.read_phases(part).finished.get(results.FAILED, {})
        for name, seeds in own.work.items():
            cell, start = found.names.index(name), own.config.run.seed
            said = noted.get(str(cell))
            left = any((name, start + seed) not in complete for seed in seeds)
            if not said and part in dead and left:
                said = _last_words(part, codes[part])
            if said:
                failed.setdefault(cell, said)
    return failed


def _last_words(part: Path, code: int) -> str:
    """What a part's process said of its end, or that it ended."""
    told = (part / LOG).read_text(errors="replace") if (part / LOG).is_file() else ""
    lines = [line for line in told.splitlines() if line.startswith("gril: ")]
    if lines:
        return lines[-1].removeprefix("gril: ").rstrip(".")
    return f"its process ended with exit code {code}"


def _command(part: Path) -> list[str]:
    """The command line that goes on with a part, in a process with one device."""
    gril = [sys.executable, "-m", "gril_jax.cli.main"]
    return [*gril, "sweep", "--resume", str(part), "--devices", "1"]


# --- processes of this machine


def on_this_machine(
    devices: Sequence[str | None], environment: Mapping[str, str], echo: Echo
) -> CarryOut:
    """Carries parts out on this machine, one process a device, each in the environment."""

    def carry_out(left: Sequence[Path]) -> dict[Path, int]:
        waiting, free, codes = [*left], [*devices], dict[Path, int]()
        running: dict[Path, tuple[subprocess.Popen, str | None]] = {}
        told = False
        with noticed() as notice:
            while waiting or running:
                while waiting and free:
                    part, device = waiting.pop(0), free.pop(0)
                    running[part] = _started(part, device, environment), device
                time.sleep(_WAIT_S)
                if notice.number and not told:
                    told, waiting = True, []
                    for process, _ in running.values():
                        process.send_signal(notice.number)
                for part, (process, device) in [*running.items()]:
                    if process.poll() is not None:
                        codes[part] = process.returncode
                        free.append(device)
                        del running[part]
                        echo(f"part {part.name} has ended, {len(running) + len(waiting)} are left")
        if notice.number:
            name = signal.Signals(notice.number).name
            how = f"gril sweep --resume {saved.root(left[0])} goes on with it"
            raise Interrupted(f"{name} came, and the parts are saved: {how}", notice.number)
        return codes

    return carry_out


def _started(part: Path, device: str | None, environment: Mapping[str, str]) -> subprocess.Popen:
    """The process of a part, in a session of its own: a Ctrl-C in the terminal is for the parent,
    which hands it on."""
    own = dict(environment) | ({} if device is None else {"CUDA_VISIBLE_DEVICES": device})
    with open(part / LOG, "ab") as log:
        return subprocess.Popen(
            _command(part), env=own, stdout=log, stderr=log, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip


# --- jobs of a cluster, by submitit


def on_a_cluster(kind: str, options: str | None, echo: Echo) -> CarryOut:
    """Carries parts out as jobs, one GPU each unless the options say otherwise.

    Raises ConfigError if these are not KEY=VALUE with commas between, or if submitit is not
    installed."""
    if importlib.util.find_spec("submitit") is None:
        raise ConfigError(
            "--cluster needs the package submitit, which is not installed: "
            "pip install 'gril-jax[cluster]'"
        )
    given: dict[str, Any] = {"slurm_job_name": "gril", "timeout_min": 240}
    given["gpus_per_node"] = int(kind == "slurm")
    for pair in filter(None, (options or "").split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise ConfigError(f"--cluster-options has {pair!r}, but must be KEY=VALUE,KEY=VALUE")
        given[key] = int(value) if value.isdecimal() else value

    def carry_out(left: Sequence[Path]) -> dict[Path, int]:
        if not left:
            return {}
        submitit = importlib.import_module("submitit")
        executor = submitit.AutoExecutor(folder=saved.root(left[0]) / "jobs", cluster=kind)
        executor.update_parameters(**given)
        running = {part: executor.submit(Job(), str(part)) for part in left}
        echo("jobs: " + ", ".join(job.job_id for job in running.values()))
        codes: dict[Path, int] = {}
        while len(codes) < len(running):
            time.sleep(_WAIT_S)
            for part, job in running.items():
                if part not in codes and job.done():
                    codes[part] = 1 if job.exception() is not None else int(job.result())
        return codes

    return carry_out


class Job:
    """The job of a part. submitit signals one that is about to be cut off, and queues it again
    after `checkpoint`."""

    def __call__(self, folder: str) -> int:
        """Carries the part out; its exit code."""
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        return subprocess.run(_command(Path(folder)), env=environment).returncode

    def checkpoint(self, folder: str) -> Any:
        """The same job once more: the part goes on where it was last saved."""
        return importlib.import_module("submitit").helpers.DelayedSubmission(Job(), folder)
