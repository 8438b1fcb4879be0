"""A Panda at a table: the room that tasks on a table share, and the tasks' entries.

A task is a module of `tasks`, with its scene and its scripted expert.
"""

from types import MappingProxyType

from gril_jax.envs.registry import TaskSpec

__all__ = [
    "EMPTY_CONTAINER", "HOME", "ITEM_IN_DRAWER", "REWARDS", "RUBBISH_IN_BIN", "SHOES_IN_BOX",
    "SHOES_OUT_OF_BOX", "UMBRELLA_OUT",
]  # fmt: skip

# The arm's joints at reset: the hand is above the things, its fingers open along y. Tool centre
# point (0.50, 0.05, 0.30).
HOME = (0.0571, -0.1029, 0.0417, -2.2644, 0.0052, 2.1616, 0.8812)

REWARDS = ("staged", "stages", "sparse")
# With the newer code generator for CPUs an arm in MJX is a thousand times slower.
_XLA_FLAGS = MappingProxyType({"0.10.": ("--xla_cpu_use_fusion_emitters=false",)})


def _spec(name: str, *, config: str = "tabletop") -> TaskSpec:
    """The entry of the task in the module of that name, which has its `ENTRY`."""
    entry = f"{__name__}.tasks.{name}:ENTRY"
    return TaskSpec(
        make=f"{entry}.make", demonstrate=f"{entry}.demonstrate", rewards=REWARDS,
        varied="states of a scripted expert's episodes",
        hints={"rich": "which of the task's stages have been reached"}, config=config,
        steps_in_mjx=True, xla_flags=_XLA_FLAGS,
    )  # fmt: skip


# All are RLBench's, built anew from primitives.
SHOES_IN_BOX = _spec("shoes_in_box", config="")
RUBBISH_IN_BIN = _spec("rubbish_in_bin")
UMBRELLA_OUT = _spec("umbrella_out")
ITEM_IN_DRAWER = _spec("item_in_drawer")
SHOES_OUT_OF_BOX = _spec("shoes_out_of_box")
EMPTY_CONTAINER = _spec("empty_container")
