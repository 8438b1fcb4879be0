"""The smallest run of each of six verbs, on the audited task of `support.new_task`."""

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
_TWO = ("--seeds", "2")
_AUDIT = ("--starts", "2", "--ascents", "4")
_ROWS = ("--rows", "environmental,ours without robot", "--steps-per-encoder", "40")
# Steps of the first rows of Table I and of soundness are the row's, or the configuration's.
VERBS = {
    "quickstart": ("quickstart", *_TINY, *_STEPS, *_POLICY, "--run.audit", "4"),
    "train": ("train", *_TINY, *_STEPS, *_POLICY),
    "pretrain": ("pretrain", *_TINY, *_STEPS),
    "sweep": (
        "sweep", *_TINY, *_STEPS, *_POLICY, *_TWO, "--reward", "learned,environmental",
    ),
    "table1": ("table1", *_TINY, *_POLICY[:-2], *_TWO, *_AUDIT, *_ROWS),
    "soundness": ("soundness", *_TINY, *_STEPS, *_POLICY, *_TWO, *_AUDIT, "--rows", "paper"),
}  # fmt: skip
# Steps that a row sets for itself are not given, nor are copies that all rows of a table set.
_OF_ROWS = ("--pretrain.num-perturbations", "--pretrain.adversarial-steps")


def command(verb):
    """A small run of a verb."""
    args = [*VERBS[verb]]
    for option in _OF_ROWS if verb in ("table1", "soundness") else ():
        at = args.index(option)
        del args[at : at + 2]
    return args
