"""A Panda at a table: the room that tasks on a table share; one folder a task.

Its constants are those of every such task's entry in the registry.
"""

from types import MappingProxyType

from gril_jax.envs.registry import TaskSpec

__all__ = ["BENCH_SETTINGS", "HINTS", "HOME", "REWARDS", "VARIED", "XLA_FLAGS", "spec"]

# The arm's joints at reset: the hand is above the things, its fingers open along y. Tool centre
# point (0.50, 0.05, 0.30).
HOME = (0.0571, -0.1029, 0.0417, -2.2644, 0.0052, 2.1616, 0.8812)

REWARDS = ("staged", "stages", "sparse")
VARIED = "moments of a scripted expert's episodes"
HINTS = MappingProxyType({"rich": "which of the task's stages have been reached"})
BENCH_SETTINGS = (
    {}, {"iterations": 4, "ls_iterations": 6}, {"iterations": 3}, {"max_contacts": 32},
    {"max_contacts": 16}, {"substeps": 5}, {"impl": "warp"}, {"impl": "warp", "substeps": 5},
)  # fmt: skip
# With the newer code generator for CPUs an arm in MJX is a thousand times slower.
XLA_FLAGS = MappingProxyType({"0.10.": ("--xla_cpu_use_fusion_emitters=false",)})


def spec(name: str, *, config: str = "tabletop") -> TaskSpec:
    """The entry of the task in the folder of that name, whose module `task` has its `ENTRY`."""
    entry = f"{__name__}.{name}.task:ENTRY"
    return TaskSpec(
        make=f"{entry}.make", demonstrate=f"{entry}.demonstrate", rewards=REWARDS,
        bench_settings=BENCH_SETTINGS, varied=VARIED, hints=HINTS, config=config,
        steps_in_mjx=True, xla_flags=XLA_FLAGS,
    )  # fmt: skip
