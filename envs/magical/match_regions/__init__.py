"""MAGICAL's MatchRegions: only green blocks belong in the region. `SPEC` is its entry."""

from gril_jax.envs.registry import TaskSpec

__all__ = ["SPEC"]

SPEC = TaskSpec(
    make="gril_jax.envs.magical.match_regions.task:MatchRegions",
    demonstrate="gril_jax.envs.magical.match_regions.expert:demonstrate",
    rewards=("S4", "V5", "sparse"),
    bench_settings=(  # of the solver, from the original's own to the coarsest, and other engines
        {"engine": "kernel", "substeps": 10, "iterations": 10},
        {"engine": "impulse", "substeps": 10, "iterations": 10},
        {"engine": "kernel", "substeps": 10, "iterations": 6},
        {"engine": "impulse", "substeps": 10, "iterations": 6},
        {"engine": "impulse", "substeps": 5, "iterations": 5},
        {"engine": "mjx", "substeps": 5, "iterations": 2}, {"variant": "all"}, {"robot": "short"},
        {"targets": ("green square",), "distractors": ("yellow circle",)},
    ),
    bench_envs=32_768,
    varied="the robot anywhere; targets in the region, on their way there or before the robot",
    hints={
        "rich": "which blocks are in the region",
        "sorted": "which blocks are in the region and which target is due",
    },
    many_starts={"demo": "jitter"},
    elsewhere={"demo": "layout", "jitter": "layout"},
)  # fmt: skip
