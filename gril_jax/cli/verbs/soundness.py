"""`gril soundness`: ways of training encoders, compared by audits and by policies."""

from types import ModuleType

from ..arguments import positional, whole_number
from ..tables import Loader, rows_taken, table


def _choose(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, steps = positional(args), whole_number(args, "--steps-per-policy", None, least=0)
    rows = rows_taken(known, args)
    config = known.with_budget(load(name, args), steps)
    return config, {"rows": rows, "policies": steps != 0}


VERB = table(
    "soundness",
    "the same by audits and by policies, and whether audits tell success; "
    "--resume RUN goes on, --join RUN,RUN makes one table",
    "Train encoders in several ways (--rows A,B; all by default) with --seeds N seeds each (5 by "
    "default), audit them from --starts N starts (4) with --ascents N ascents (1000), and train a "
    "policy with each, of --steps-per-policy N control steps (the configuration's own; 0 trains "
    "none), at most --policies-at-once N in one program (25).",
    _choose,
)
