"""Verbs that say what works on this machine, and how fast; figures of benchmarks are JSON.

Each check of the doctor is a process of its own with a time limit: a package that crashes on
import, or an OpenGL driver that hangs, becomes a row of the table.
"""

import importlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from gril_jax.config import TaskName
from gril_jax.config.files import load
from gril_jax.config.tables import count, optional
from gril_jax.runs.reading import package_versions

from ..arguments import Work, echo
from ..heavy_imports import GL_FAULT, heavy_imports
from . import Verb, simple

# --- the doctor


@dataclass(frozen=True)
class _Doctor:
    timeout_s: float = 120.0
    """Time limit of each check, seconds."""


def _doctor(given: _Doctor) -> Work:
    def work() -> int:
        checks = check_all(timeout_s=given.timeout_s)
        echo(table(checks))
        return int(any(check.needed and not check.works for check in checks))

    return work


_DEVICES = "import jax; print(', '.join(str(d) for d in jax.devices()))"

_JIT = """
import jax, jax.numpy as jnp
value = float(jax.jit(lambda x: (x @ x).sum())(jnp.ones((8, 8))))
assert value == 512.0, value
print('a compiled product is right')
"""

_GL = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/>"
    "<geom type='sphere' size='1' rgba='1 0 0 1'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 32, 32) as renderer:
    renderer.update_scene(data)
    image = renderer.render()
assert image.any(), 'the image is black'
print('renders')
"""

_MJX = """
import contextlib, io
with contextlib.redirect_stdout(io.StringIO()):  # it reports optional parts on import
    import mujoco
    from mujoco import mjx
mjx.put_model(mujoco.MjModel.from_xml_string("<mujoco/>"))
print('a model loads')
"""

_X264 = """
import io
import av, numpy
with av.open(io.BytesIO(), 'w', format='mp4') as container:
    stream = container.add_stream('libx264', rate=8)
    stream.width = stream.height = 32
    stream.pix_fmt = 'yuv420p'
    frame = av.VideoFrame.from_ndarray(numpy.zeros((32, 32, 3), numpy.uint8), format='rgb24')
    packets = stream.encode(frame) + stream.encode()
    container.mux(packets)
assert packets
print('libx264 encodes')
"""


_LACKS = {
    "egl": "nothing renders with EGL: install libegl1",
    "osmesa": "nothing renders with OSMesa: install libosmesa6",
    "glfw": "nothing renders with GLFW, which needs a display",
}


class Check(NamedTuple):
    """One row of the table."""

    name: str
    works: bool
    needed: bool  # nothing runs without it
    detail: str

    @property
    def verdict(self) -> str:
        """In a word."""
        return "ok" if self.works else "BROKEN" if self.needed else "no"


def check_all(*, timeout_s: int | float = 120.0) -> list[Check]:
    """Runs every check, in the order of the table."""
    rows = [Check("python", True, True, platform.python_version())]
    for name, version in package_versions().items():
        rows.append(Check(name, version != "missing", True, version))
    needed = {"jax devices": _DEVICES, "jax compiles": _JIT, "mjx": _MJX}
    rows += [probe(name, code, timeout_s=timeout_s, gl_backend="") for name, code in needed.items()]
    if chosen := os.environ.get("MUJOCO_GL"):
        one = probe("MUJOCO_GL", "import mujoco; print('can be used')", timeout_s=timeout_s)
        said = one.detail if one.works else GL_FAULT.format(value=chosen)
        rows.append(one._replace(detail=said))
    for backend, lacks in _LACKS.items():
        one = probe(
            f"MUJOCO_GL={backend}", _GL, needed=False, timeout_s=timeout_s, gl_backend=backend
        )
        rows.append(one if one.works else one._replace(detail=f"{lacks} ({one.detail:.60})"))
    return [*rows, probe("video", _X264, needed=False, timeout_s=timeout_s)]


def probe(
    name: str,
    code: str,
    *,
    needed: bool = True,
    timeout_s: int | float,
    gl_backend: str | None = None,
) -> Check:
    """Runs Python code in a separate process; its last printed line is the detail."""
    environment = dict(os.environ)
    if gl_backend is not None:
        environment |= {"MUJOCO_GL": gl_backend, "PYOPENGL_PLATFORM": gl_backend}
        if gl_backend in ("glfw", ""):  # "" is MuJoCo's own choice
            del environment["PYOPENGL_PLATFORM"]
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, timeout=timeout_s,
            capture_output=True, text=True, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Check(name, False, needed, f"no answer in {timeout_s:g} s")
    if done.returncode == 0:
        return Check(name, True, needed, _last_line(done.stdout))
    if done.returncode < 0:
        return Check(name, False, needed, f"stopped by signal {-done.returncode}")
    # The exception's own line: a renderer that fails to start complains again when freed.
    head = done.stderr.split("Exception ignored in")[0]
    return Check(name, False, needed, _last_line(head) or _last_line(done.stderr))


def table(checks: Sequence[Check]) -> str:
    """The rows in aligned columns."""
    width = max(len(check.name) for check in checks)
    return "\n".join(f"{c.name:<{width}}  {c.verdict:<8}  {c.detail}".rstrip() for c in checks)


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1][:200]


# --- benchmarks

_PARTS = ("training", "seeds", "devices")


@dataclass(frozen=True)
class _Nothing:
    """Nothing to choose."""


@dataclass(frozen=True)
class _Train:
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Environments; None is 256 on a CPU and 8,192 elsewhere."""
    engine: Literal["auto", "kernel", "impulse"] = "auto"
    """Physics solver."""
    variant: Literal["demo", "jitter", "layout", "color", "shape", "dynamics", "all"] = "demo"
    """Quantities randomised at the start of an episode."""
    parts: tuple[Literal[*_PARTS], ...] = _PARTS
    """Parts to measure; devices only where there are several."""
    repeats: int = field(default=5, metadata=count())
    """Timed calls of each program."""


@dataclass(frozen=True)
class _Env:
    task: TaskName = "match_regions"
    """The task to step."""
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Episodes in parallel; None is 256 on a CPU, and elsewhere 32,768, or 4,096 for the shoes."""
    steps: int = field(default=20, metadata=count())
    """Control steps of each timed run."""


def _benchmark(name: str, summary: str, options: type = _Nothing) -> Verb:
    """The verb of `gril_jax.experiments.bench.NAME`, whose `main` returns the figures."""

    def plan(given: Any) -> Work:
        chosen = vars(given)
        config = load(chosen["task"]) if "task" in chosen else None  # XLA's options depend on it

        def work() -> None:
            with heavy_imports(config):
                frame = importlib.import_module("gril_jax.experiments.bench.frame")
                module = importlib.import_module(f"gril_jax.experiments.bench.{name}")
            figures = module.main(**chosen)
            echo(json.dumps(frame.machine() | figures, indent=2))

        return work

    return simple(f"bench {name}", summary, options, plan)


VERBS = {
    "This machine": (
        simple(
            "doctor", "what is installed and what works on this machine", _Doctor, _doctor,
        ),
        _benchmark("train", "training with and without the learned reward", _Train),
        _benchmark("env", "how many control steps a second the task makes here", _Env),
        _benchmark("losses", "the losses beside those of other libraries"),
    )
}  # fmt: skip
