"""`gril train`: a reward, then a policy from it."""

from ..arguments import Work, positional
from ..new_run import new_run
from ..verb import Verb


def _plan(args: list[str]) -> Work:
    about = "Learn a reward, then a policy from it."
    return new_run("train", positional(args), args, "gril train", about)


VERB = Verb(
    "train [CONFIG]",
    "the same for any configuration",
    _plan,
    {
        "train|pretrain|sweep --resume RUN": "go on with what was cut off, bit for bit",
        "train|pretrain --hard-negatives RUN[,RUN]":
            "learn from states that earlier rewards overestimated",
    },
)  # fmt: skip
