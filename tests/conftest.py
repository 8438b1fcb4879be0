"""Set before any test imports JAX: the suite is for the CPU, whatever else a machine has."""

import collections
import gc
import importlib.metadata
import os
import pathlib

import pytest

TESTS = pathlib.Path(__file__).parent

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Much of the time goes to compiling: less without optimisation, and with the older code generator.
# Without optimisation XLA 0.10's code for AVX2 is wrong: tests/losses/test_cycle.py shows it, a
# gradient of the form "classification"; its code for AVX passes.
# XLA aborts over a flag that it does not know: hence the version.
FLAGS = ["--xla_backend_optimization_level=1"]
if importlib.metadata.version("jaxlib").startswith("0.10."):
    FLAGS = ["--xla_backend_optimization_level=0", "--xla_cpu_max_isa=AVX"]
    FLAGS.append("--xla_cpu_use_fusion_emitters=false")
    FLAGS.append("--xla_cpu_parallel_codegen_split_count=1")  # both cores have a worker already
os.environ.setdefault("XLA_FLAGS", " ".join(FLAGS))

# What was compiled once, by the other worker or an hour ago, need not be again: JAX finds a program
# by its operations, these flags and its own version. `pytest --cache-clear` forgets them.
PROGRAMS = TESTS.parent / ".pytest_cache" / "d" / "jax"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(PROGRAMS))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

# Files that take longest come first, or one worker would play its last alone.
LONGEST = """pipeline envs/magical/match_regions/expert docs report/run_report
envs/tabletop/shoes_in_box envs/planar/physics envs/magical/raster pretraining/pretrain
compilation/sharding pretraining/pixel_pretrain pretraining/contrast encoders/encoder rl/ppo
envs/magical/match_regions/task experiments/adding demos/vision/detect envs/planar/mjx_engine
runs/faults api/front_door cli/own_tasks own_films jax_modes config/files""".split()

SECONDS: collections.Counter[str] = collections.Counter()  # of each file, tests and fixtures
SLOWEST = 10


@pytest.fixture(scope="session", autouse=True)
def _large_programs_too():
    """The library's own choice for its large programs would take the place of these flags."""
    from gril_jax.compilation import compiler  # late: after the hook that checks types

    with pytest.MonkeyPatch.context() as patch:
        for options in (compiler._OPTIONS, compiler._BRIEF):
            patch.setitem(options, "cpu", {})
        yield


@pytest.fixture(scope="session", autouse=True)
def _own_record(tmp_path_factory):
    """Which task files were named is noted below a folder of the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


def pytest_configure(config):
    """pytest-xdist would hand out first the files with the most tests."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """By file; the order within one is kept."""
    rank = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(_name(item.path), len(rank)))


def pytest_collection_finish():
    """What has been imported is no garbage: the collector need not look at it again."""
    gc.collect()
    gc.freeze()


def _name(path):
    """losses/batch for tests/losses/test_batch.py."""
    return path.relative_to(TESTS).with_suffix("").as_posix().replace("test_", "")


def pytest_runtest_logreport(report):
    SECONDS[report.nodeid.partition("::")[0]] += report.duration


def pytest_terminal_summary(terminalreporter):
    """The files worth making faster."""
    if len(SECONDS) > SLOWEST:
        terminalreporter.section(f"{SLOWEST} slowest files")
        for name, seconds in SECONDS.most_common(SLOWEST):
            terminalreporter.write_line(f"{seconds:6.1f} s  {name}")
