"""Set before any test imports JAX: the suite is for the CPU, whatever else a machine has."""

import importlib.metadata
import os
import pathlib

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Most of the time goes to compiling: at a lower level of optimisation, and with the older code
# generator, it is a third less. XLA aborts over a flag that it does not know: hence the version.
FLAGS = ["--xla_backend_optimization_level=1"]
if importlib.metadata.version("jaxlib").startswith("0.10."):
    FLAGS.append("--xla_cpu_use_fusion_emitters=false")
    FLAGS.append("--xla_cpu_parallel_codegen_split_count=1")  # both cores have a worker already
os.environ.setdefault("XLA_FLAGS", " ".join(FLAGS))

# Files that take longest come first, or one worker would play its last alone.
LONGEST = """pipeline hosts sharding planar_physics ppo match_regions scripted sampling_planner
pretrain_loss pretrain encoder training sac planar_mjx soft_dtw contacts examples report
export_policy ablate subtasks reward magical_replay""".split()


def pytest_configure(config):
    """pytest-xdist would hand out first the files with the most tests."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """By file; the order within one is kept."""
    rank = {f"test_{name}": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(pathlib.Path(item.path).stem, len(rank)))
