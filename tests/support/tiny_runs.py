"""The smallest runs of four verbs, with both algorithms, and of two studies, on the audited task of
`support.new_task`."""

_TASK = "reach_task:SPEC"
_TINY = (
    *("--env.name", _TASK, "--env.episode-length", "12", "--encoder.width", "8"),
    *("--encoder.latent", "4", "--encoder.rounds", "1", "--demos.num", "4"),
    *("--demos.num-validation", "2", "--demos.num-failures", "1", "--pretrain.num-videos", "3"),
    *("--pretrain.num-perturbations", "0", "--pretrain.adversarial-steps", "0"),
    *("--run.checkpoint-every", "0", "--out", "run"),
)
_STEPS = ("--pretrain.steps", "40")
_POLICY = (
    *("--ppo.num-envs", "8", "--ppo.unroll-length", "4", "--ppo.num-timesteps", "320"),
    *("--ppo.num-minibatches", "2", "--ppo.hidden", "8", "--run.eval-episodes", "4"),
    *("--run.updates-per-chunk", "1", "--run.evaluations", "0"),
)
_SAC = (  # whose replay is full after half of the run, and overwritten from then on
    *("--algorithm", "sac", "--sac.num-envs", "8", "--sac.unroll-length", "4"),
    *("--sac.num-timesteps", "320", "--sac.replay-size", "160", "--sac.min-replay", "32"),
    *("--sac.batch-size", "16", "--sac.updates-per-step", "2", "--sac.hidden", "8"),
    *_POLICY[-6:],
)
_TWO = ("--seeds", "2")
_AUDIT = ("--starts", "2", "--ascents", "4")
_ROWS = ("--rows", "environmental,ours without robot")
VERBS = {
    "quickstart": ("quickstart", *_TINY, *_STEPS, *_POLICY, "--run.audit", "4"),
    "sac": ("train", *_TINY, *_STEPS, *_SAC),
    "train": ("train", *_TINY, *_STEPS, *_POLICY),
    "pretrain": ("pretrain", *_TINY, *_STEPS),
    "sweep": ("sweep", *_TINY, *_STEPS, *_POLICY, *_TWO, "--reward", "learned,environmental"),
    "table1": ("sweep", "table1", *_TINY, *_STEPS, *_POLICY[:-2], *_TWO, *_AUDIT, *_ROWS),
    "soundness": (
        "sweep", "soundness", *_TINY, *_STEPS, *_POLICY, *_TWO, *_AUDIT, "--rows", "paper",
    ),
}  # fmt: skip


def command(verb):
    """A small run of a verb, or of a study by its name."""
    return [*VERBS[verb]]
