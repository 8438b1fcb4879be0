"""RLBench's shoes in the box: open its lid, then put both shoes in. `SPEC` is its entry."""

from gril_jax.envs import tabletop
from gril_jax.envs.registry import TaskSpec

__all__ = ["SPEC"]

SPEC = TaskSpec(
    make="gril_jax.envs.tabletop.shoes_in_box.task:shoes_in_box",
    demonstrate="gril_jax.envs.tabletop.shoes_in_box.task:demonstrate",
    rewards=tabletop.REWARDS,
    bench_settings=tabletop.BENCH_SETTINGS,
    varied=tabletop.VARIED,
    hints=tabletop.HINTS,
    steps_in_mjx=True,
    xla_flags=tabletop.XLA_FLAGS,
)
