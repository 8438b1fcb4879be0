"""`gril table1`: the paper's Table I and Figure 2."""

from types import ModuleType

from ..arguments import positional, require_left_to_options, whole_number
from ..tables import Loader, rows_taken, table


def _choose(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name = positional(args) or ("quickstart" if quick else "match_regions")
    steps = whole_number(args, "--steps-per-encoder", known.QUICK_STEPS if quick else None)
    rows = known.with_steps(rows_taken(known, args, known.QUICK if quick else None), steps)
    require_left_to_options(args, known.paths(rows))
    # of two the later one counts
    config = load(name, ["--run.evaluations", str(known.EVALUATIONS), *args])
    known.check(config)
    return config, {"rows": rows}


VERB = table(
    "table1",
    "the paper's Table I and Figure 2: policies with rewards of all kinds; "
    "--quick on a laptop, --resume RUN goes on",
    "Train policies with rewards of several kinds (--rows A,B; all by default), --seeds N of each "
    "(5), alike in all else: the paper's Table I and Figure 2. Learned rewards are audited with "
    "--ascents N ascents (1000) from --starts N starts (4). --steps-per-encoder N trains all "
    "encoders for N gradient steps, instead of each as its row says. --quick makes two rows with "
    "two seeds of the configuration quickstart.",
    _choose,
)
