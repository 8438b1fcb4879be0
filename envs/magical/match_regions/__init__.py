"""MAGICAL's MatchRegions: only green blocks belong in the region. `SPEC` is its entry."""

from gril_jax.envs.registry import TaskSpec

__all__ = ["SPEC"]

SPEC = TaskSpec(
    make="gril_jax.envs.magical.match_regions.task:MatchRegions",
    demonstrate="gril_jax.envs.magical.match_regions.expert:demonstrate",
    rewards=("S4", "V5", "sparse"),
    bench_envs=32_768,
    varied="the robot anywhere; targets in the region, on their way there or before the robot",
    hints={
        "rich": "which blocks are in the region",
        "sorted": "which blocks are in the region and which target is next",
    },
    many_starts={"demo": "jitter"},
    elsewhere={"demo": "layout", "jitter": "layout"},
)  # fmt: skip
