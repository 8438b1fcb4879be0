"""`gril ablate`: the choices of encoder training, each changed alone."""

from types import ModuleType

from ..arguments import positional
from ..tables import Loader, rows_taken, table


def _choose(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, rows = positional(args), rows_taken(known, args)
    return load(name, args), {"rows": rows}


VERB = table(
    "ablate",
    "which choices of the reward's training matter, over seeds",
    "Change each choice of encoder training alone (--rows A,B; all by default), over --seeds N "
    "seeds (5 by default).",
    _choose,
)
