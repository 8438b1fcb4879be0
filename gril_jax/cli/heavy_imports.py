"""Heavy imports, done only after a verb has understood its command line."""

import contextlib
import gc
import io
import logging
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module, metadata
from pathlib import Path

from gril_jax import threads
from gril_jax.config import MakeDemosConfig
from gril_jax.config.task import NO_TASK
from gril_jax.envs import registry
from gril_jax.errors import ConfigError

_THREADS = 4  # of XLA on a CPU, that two of them may block

GL_FAULT = (
    "MUJOCO_GL is {value!r}, but MuJoCo cannot be imported with that here: unset it, or see which "
    "works with gril doctor"
)


def _set_for(config: MakeDemosConfig) -> None:
    """Sets the options that a task needs."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    task = None if config.env.name == NO_TASK else registry.spec(config.env.name)
    for version, needed in (task.xla_flags if task else {}).items():
        if metadata.version("jaxlib").startswith(version):
            flags += needed
    if flags:
        os.environ["XLA_FLAGS"] = " ".join(flags)
    if ((task and task.steps_in_mjx) or config.env.engine == "mjx") and threads.cores() < _THREADS:
        # jaxlib's Cholesky of a batch (0.10.2) blocks a thread of XLA's pool until others have
        # done the work. MJX has two at once, which on two cores wait for each other for ever.
        os.environ.setdefault("PJRT_NPROC", str(_THREADS))


@contextlib.contextmanager
def heavy_imports(
    config: MakeDemosConfig | None = None, *, devices: bool = False
) -> Iterator[None]:
    """Context for importing JAX and MuJoCo: sets XLA's options and threads, as the config of what
    is to be done needs them, and keeps reports of MJX on missing parts from stdout.

    With `devices` JAX takes its devices meanwhile, or a ConfigError says why it cannot; not for
    what leaves them to other processes, or has to connect to other hosts first.

    Raises:
      ConfigError: a task or device cannot be had, or JAX is told to compute in float64.
    """
    _require_usual_jax()
    _require_mujoco()
    if config is not None:
        _set_for(config)
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gril_jax" / "jax"
    with contextlib.suppress(OSError):  # without a writable cache everything works, only slower
        folder.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
        # A run has hundreds of small programs: together they take longer than the large ones.
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    # One kernel for random bits, the same ones: else a GPU's compiler has a hundred operations to
    # fuse for each draw.
    os.environ.setdefault("JAX_THREEFRY_GPU_KERNEL_LOWERING", "1")
    # OpenCV's threads cost more than they bring on pictures this small.
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    # A callback of a task that fails ends the command with a sentence, and no traceback before it.
    logging.getLogger("jax._src.callback").setLevel(logging.CRITICAL)
    with (
        contextlib.redirect_stdout(io.StringIO()),
        _spared_from_collection(),
        _taken_devices() if devices else contextlib.nullcontext(),
    ):
        yield


_UNFIT = {
    # Checkpoints, files of rewards and policies, and results are float32.
    "JAX_ENABLE_X64": "gril computes in float32",
    "JAX_DISABLE_JIT": "gril compiles its programs before it runs them",
}


def _require_usual_jax() -> None:
    """Refuses what a run could not do with, and would find out only in the middle."""
    for name, reason in _UNFIT.items():
        value = os.environ.get(name, "0")
        if value.lower() in ("0", "false", "f", "no", "n", "off"):
            continue
        raise ConfigError(f"{name} is {value!r}, but {reason}: unset it, or set it to 0")


def _require_mujoco() -> None:
    """Refuses a backend of OpenGL that MuJoCo cannot be imported with: it needs none to compute."""
    value = os.environ.get("MUJOCO_GL")
    if value:
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                import_module("mujoco")
        except (ImportError, AttributeError, OSError, RuntimeError):
            raise ConfigError(GL_FAULT.format(value=value)) from None


@contextlib.contextmanager
def _spared_from_collection() -> Iterator[None]:
    """Freezes imported modules out of garbage collection, else a fifth of a short run's time."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@contextlib.contextmanager
def _taken_devices() -> Iterator[None]:
    """Initialises the devices during imports: a GPU takes two seconds until its first array."""
    import jax  # in this thread, since two that import the same could see it half done

    with ThreadPoolExecutor(1, "devices") as pool:
        array = pool.submit(lambda: jax.block_until_ready(jax.numpy.zeros(())))
        yield
    if array.exception() is not None:
        fault = next(iter(str(array.exception()).splitlines()), "none of them is here")
        if chosen := os.environ.get("JAX_PLATFORMS"):
            raise ConfigError(f"JAX_PLATFORMS is {chosen!r}, but JAX cannot use these: {fault}")
        raise ConfigError(f"JAX cannot use this machine's devices: {fault}")
