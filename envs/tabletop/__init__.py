"""A Panda at a table: the room that tasks on a table share; one folder a task.

Its constants are those of every such task's entry in the registry.
"""

from types import MappingProxyType

__all__ = ["BENCH_SETTINGS", "HINTS", "REWARDS", "VARIED", "XLA_FLAGS"]

REWARDS = ("staged", "stages", "sparse")
VARIED = "moments of a scripted expert's episodes"
HINTS = MappingProxyType({"": "which of the task's stages have been reached"})
BENCH_SETTINGS = (
    {}, {"iterations": 4, "ls_iterations": 6}, {"iterations": 3}, {"max_contacts": 32},
    {"max_contacts": 16}, {"substeps": 5}, {"impl": "warp"}, {"impl": "warp", "substeps": 5},
)  # fmt: skip
# With the newer code generator for CPUs an arm in MJX is a thousand times slower.
XLA_FLAGS = MappingProxyType({"0.10.": ("--xla_cpu_use_fusion_emitters=false",)})
