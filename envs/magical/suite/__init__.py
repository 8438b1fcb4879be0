"""MAGICAL's eight tasks with its own draws; their entries."""

from gril_jax.envs.registry import TaskSpec

__all__ = [
    "CLUSTER_COLOUR", "CLUSTER_SHAPE", "FIND_DUPE", "FIX_COLOUR", "MAKE_LINE",
    "MATCH_REGIONS_MAGICAL", "MOVE_TO_CORNER", "MOVE_TO_REGION",
]  # fmt: skip


def _spec(task: str, *, layout: bool = True) -> TaskSpec:
    further = {"demo": "layout", "jitter": "layout"} if layout else {}
    return TaskSpec(
        make=f"gril_jax.envs.magical.suite.{task}",
        demonstrate="",
        rewards=("sparse",),
        bench_envs=32_768,
        config="magical_suite",
        many_starts={"demo": "jitter"},
        elsewhere=further,
    )


MOVE_TO_CORNER = _spec("move_to:MoveToCorner", layout=False)
MOVE_TO_REGION = _spec("move_to:MoveToRegion")
FIND_DUPE = _spec("in_regions:FindDupe")
FIX_COLOUR = _spec("in_regions:FixColour")
CLUSTER_COLOUR = _spec("together:ClusterColour")
CLUSTER_SHAPE = _spec("together:ClusterShape")
MAKE_LINE = _spec("together:MakeLine")
MATCH_REGIONS_MAGICAL = _spec("in_regions:MatchRegions")
