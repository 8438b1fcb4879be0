"""`gril table2`: the paper's Table II."""

from types import ModuleType

from ..arguments import echo, positional
from ..tables import Loader, rows_taken, table


def _choose(known: ModuleType, args: list[str], quick: bool, load: Loader):
    from gril_jax.experiments.tables.rows import require_learned

    name, every = positional(args), not quick and not any(arg.startswith("--rows") for arg in args)
    rows = rows_taken(known, args, known.QUICK_ROWS if quick else None)
    usual = known.QUICK if quick else known.USUAL if name is None else {}
    # what is said on the command line counts for more
    args = [f"--{path}={value}" for path, value in usual.items()] + args
    config = load(name or "shoes_in_box", args)
    require_learned(config)
    return config, {"rows": known.usable(config, echo) if every else rows}


VERB = table(
    "table2",
    "the paper's Table II: rewards that tell success from failure; --quick, --resume RUN",
    "Train encoders in several ways (--rows A,B; all that the configuration allows by default), "
    "--seeds N of each (5), and measure how well their rewards tell success from failure: the "
    "paper's Table II. --quick makes two seeds of the rows without pictures from fewer "
    "demonstrations.",
    _choose,
)
