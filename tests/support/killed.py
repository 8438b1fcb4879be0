"""Command lines of gril that are killed, starved or interrupted, each in a process of its own.

The processes are forks of one that has imported all: an import takes longer than a small run.
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

# Reads command lines, runs each in a fork of itself, and tells its exit status. A fork gets
# signals so many seconds after its n-th change of a file in the run's folder.
_PARENT = """
import json, os, resource, signal, sys, threading, time, warnings
from gril_jax.cli.main import main
from gril_jax.cli.heavy_imports import heavy_imports
with heavy_imports():
    from gril_jax.workflows import pretrain, train
    from gril_jax.workflows.study import driver
warnings.simplefilter("ignore", RuntimeWarning)  # of forks: JAX has no devices yet
_CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "shutil.rmtree")
_WRITES = os.O_WRONLY | os.O_RDWR

def strike(job):
    time.sleep(job["delay_s"])
    for number in job["signals"]:
        os.kill(os.getpid(), number)
        time.sleep(0.02)

def counted(job):
    # Counts changes; at the one that is asked for, signals are on their way.
    count, inside, mine = [0], f"{os.getcwd()}/", f"{job['out']}/"
    def changed(event, args):
        if event != "open" and event not in _CHANGES:
            return
        if event == "open" and not (args[2] or 0) & _WRITES:
            return
        if f"{args[0]}/".removeprefix(inside).startswith(mine):
            count[0] += 1
            if count[0] == job["change"]:
                threading.Thread(target=strike, args=(job,), daemon=True).start()
    sys.addaudithook(changed)
    return count

def starve(job):
    for name, most in job["limits"].items():
        kind = getattr(resource, "RLIMIT_" + name)
        resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))
    if job["limits"].get("FSIZE"):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    if job["stdout"] == "closed":
        os.close(1)
        sys.stdout = None  # as Python begins without it
    elif job["stdout"] == "full":
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
    elif job["stdout"] == "gone":
        read, write = os.pipe()
        os.close(read)
        os.dup2(write, 1)

def run(job):
    os.chdir(job["folder"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whatever started the tests
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(name, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), number)
    sys.argv = ["gril", *job["args"]]
    count = counted(job)
    starve(job)
    code = main()
    if not any((code, job["limits"], job["stdout"])):
        sys.stdout.flush()
        with open("changes", "w") as file:
            print(count[0], file=file)
    threading._shutdown()  # waits for threads, as an interpreter does at its end
    os._exit(code)

for line in sys.stdin:
    child = os.fork()
    if not child:
        try:
            run(json.loads(line))
        finally:
            import traceback
            traceback.print_exc()
            os._exit(99)
    _, status = os.waitpid(child, 0)
    print(os.waitstatus_to_exitcode(status), flush=True)
"""


class Ended(NamedTuple):
    """A process that ended: its exit code, or minus the signal, and what it said."""

    code: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """The last line of its errors."""
        return (self.err.splitlines() or [""])[-1]


class Killer:
    """Runs command lines whose own folder is `out`, in folders."""

    def __init__(self, process: subprocess.Popen, path: Path, out: str):
        self._process, self._out, self.path = process, out, path

    def run(
        self,
        folder: Path,
        args: Sequence[str],
        *,
        change: int = 0,
        delay_s: float = 0.0,
        signals: Sequence[int] = (9,),
        limits: dict[str, int] | None = None,
        stdout: str = "",
    ) -> Ended:
        """The command line in a folder.

        Args:
          change, delay_s, signals: signals come so long after a change of the run's folder,
            counted from 1; 0: none comes.
          limits: of resources, such as {"NOFILE": 30}.
          stdout: "closed", "full" or "gone"; else it goes to a file.
        """
        folder.mkdir(exist_ok=True)
        job = {"folder": str(folder), "args": [*args], "out": self._out, "change": change}
        job |= {"delay_s": delay_s, "signals": [*signals], "limits": limits or {}}
        job |= {"stdout": stdout}
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        code = int(self._process.stdout.readline())
        return Ended(code, (folder / "out").read_text(), (folder / "err").read_text())

    @staticmethod
    def changes(folder: Path) -> int:
        """Changes of files that the last command line made that came to its end undisturbed."""
        return int((folder / "changes").read_text())


@contextlib.contextmanager
def killer(path: Path, out: str = "run") -> Iterator[Killer]:
    """A parent of such processes, whose Python finds packages in a folder, too."""
    environment = os.environ | {"PYTHONPATH": str(path), "JAX_PLATFORMS": "cpu"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)  # not to be written by what is killed
    process = subprocess.Popen(
        [sys.executable, "-c", _PARENT],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip
    try:
        yield Killer(process, path, out)
    finally:
        process.stdin.close()
        process.wait()
