"""The functions of the package's front door: from videos to a reward, from a reward to a policy."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    inputs="import_videos load_demos make",
    policies="evaluate load_policy train_policy",
    rewards="Audit Subtasks audit_reward find_subtasks learn_reward",
    trained_policy="Rates TrainedPolicy",
)
