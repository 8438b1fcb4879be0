"""`gril quickstart`: `gril train` with a configuration for a laptop."""

from ..arguments import Work
from ..new_run import new_run
from ..verb import Verb


def _plan(args: list[str]) -> Work:
    resumes = any(arg.partition("=")[0] == "--resume" for arg in args)
    name = None if resumes else "quickstart"  # what goes on may have begun otherwise
    about = "Learn a reward, then a policy from it."
    return new_run("train", name, args, "gril quickstart", about)


VERB = Verb("quickstart", "a small run from demonstrations to a policy, on a laptop", _plan)
