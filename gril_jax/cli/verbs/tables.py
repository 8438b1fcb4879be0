"""Verbs that make tables of named rows: to begin, to go on with a run, to join several.

A table `name` has its rows in `gril_jax.workflows.study.NAME.rows`, which imports neither JAX nor
MuJoCo, and its `TABLE` in `gril_jax.workflows.study.NAME.NAME`. Its rows may have `Settings`.
"""

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.runs import run_dir

from .. import help_page, own_tasks
from ..arguments import Work, echo, existing_folder
from ..heavy_imports import heavy_imports
from ..words import positional, require_left_to_options, run_config, take, whole_number
from . import Verb

Loader = Callable[[str | None, list[str]], RunConfig]  # from a configuration's name and options

_ROWS = {"--rows A,B": "Names of rows. (default: all)"}
_SEEDS = {"--seeds N": "Seeds of each row, of which each is one observation. (default: 5)"}
_STEPS = {"--steps-per-encoder N": "Gradient steps of all encoders, not of each as its row says."}
_AUDIT = {
    "--ascents N": "Gradient ascents of the audit of each reward. (default: 1000)",
    "--starts N": "Starts that share them. (default: 4)",
}


def _table(
    name: str,
    summary: str,
    about: str,
    own: Mapping[str, str],
    choose: Callable[[ModuleType, list[str], bool, Loader], tuple[RunConfig, dict[str, Any]]],
    sections: help_page.Sections = help_page.TABLE,
) -> Verb:
    """The verb of a table; `summary` is for the help of `gril`, `about` for its own, in which the
    texts of its `own` options come first, then the `sections` of others.

    From the module of the rows, the arguments, whether --quick is among them, and what loads a
    configuration, `choose` makes this and the settings that are not whole numbers.
    """

    def load(config: str | None, args: list[str]) -> RunConfig:
        return run_config(config, args, f"gril {name}", about, sections, own=own)

    def plan(args: list[str]) -> Work:
        # Names and numbers only: it imports neither JAX nor MuJoCo.
        named_rows = importlib.import_module("gril_jax.workflows.study.rows")
        known = importlib.import_module(f"gril_jax.workflows.study.{name}.rows")
        kind = getattr(known, "Settings", named_rows.Settings)
        other = _begun(args, name, kind) or _joined(args, name)
        if other is not None:
            return other
        if quick := hasattr(known, "QUICK_SEEDS") and "--quick" in args:
            args.remove("--quick")
        usual = kind(known.ROWS, **({"seeds": known.QUICK_SEEDS} if quick else {}))
        numbers = {
            key: whole_number(args, f"--{key.replace('_', '-')}", value)
            for key, value in vars(usual).items()
            if type(value) is int
        }
        config, chosen = choose(known, args, quick, load)
        settings = dataclasses.replace(usual, **numbers, **chosen)
        if hasattr(known, "check_settings"):
            known.check_settings(config, settings)
        return made(name, config, lambda: settings)

    return Verb(f"{name} [CONFIG]", summary, plan)


def _rows_taken(known: ModuleType, args: list[str], usual: str | None = None):
    """Takes --rows off the arguments; the rows that it names, or the usual ones."""
    from gril_jax.workflows.study.rows import chosen_rows

    return chosen_rows(take(args, "--rows") or usual, known.ROWS)


def made(
    name: str,
    config: RunConfig,
    settings: Callable[[], Any],
    resume: Path | None = None,
    cluster: dict[str, Any] | None = None,
) -> Work:
    """The table of a new run, or of one to go on with, in the processes of a cluster if given.

    `settings` makes what rows do not have in common, when JAX may be imported.
    """

    def work() -> None:
        with heavy_imports(config, devices=cluster is None):
            if cluster is not None:  # before anything else touches JAX
                from gril_jax.runs import hosts

                hosts.initialize(cluster)
            from gril_jax.workflows.study import frame

            family = _family(name)
        frame.make(family, config, settings(), resume=resume, echo=echo)

    return work


def of_results(function: str, name: str, *args: Any) -> Work:
    """The work of a function of `gril_jax.workflows.study.results`, such as `redraw`."""

    def work() -> None:
        with heavy_imports():
            from gril_jax.workflows.study import results

            family = _family(name)
        getattr(results, function)(family, *args, echo=echo)

    return work


def _family(name: str) -> Any:
    folder = "sweeps" if name == "sweep" else name
    return importlib.import_module(f"gril_jax.workflows.study.{folder}.{name}").TABLE


def not_beside(args: list[str], option: str, takes: str) -> None:
    """Raises ConfigError if there is anything beside an option that stands alone."""
    if args:
        raise ConfigError(f"{option} takes {takes}, so {args[0]} must not be given beside it")


def _begun(args: list[str], name: str, kind: type) -> Work | None:
    """The work that is left where --resume is given; None without it."""
    from gril_jax.workflows.study.rows import read_settings

    given = take(args, "--resume")
    if given is None:
        return None
    task = take(args, "--task")
    not_beside(args, "--resume", f"its options from {given}")
    folder = Path(given)
    config, settings = run_dir.require_resumable(folder, name), read_settings(folder, name, kind)
    own_tasks.of_run(config, task, folder)
    return made(name, config, lambda: settings, folder)


def _joined(args: list[str], name: str) -> Work | None:
    """The work where --join is given, with --out alone beside it; None without it."""
    names = take(args, "--join")
    if names is None:
        return None
    out = take(args, "--out")
    not_beside(args, "--join", "--out alone")
    if out is None:
        raise ConfigError("--out is missing, but must name the folder to make for the joined table")
    folders = [Path(folder) for folder in names.split(",")]
    for folder in folders:
        run_dir.read_config(folder)
    run_dir.require_new(Path(out))
    return of_results("join", name, folders, Path(out))


def _ablate(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, rows = positional(args), _rows_taken(known, args)
    return load(name, args), {"rows": rows}


def _soundness(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, steps = positional(args), whole_number(args, "--steps-per-policy", None, least=0)
    rows = _rows_taken(known, args)
    config = known.with_budget(load(name, args), steps)
    return config, {"rows": rows, "policies": steps != 0}


def _table1(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name = positional(args) or ("quickstart" if quick else "match_regions")
    steps = whole_number(args, "--steps-per-encoder", known.QUICK_STEPS if quick else None)
    rows = known.with_steps(_rows_taken(known, args, known.QUICK if quick else None), steps)
    require_left_to_options(args, known.paths(rows))
    # of two the later one counts
    config = load(name, ["--run.evaluations", str(known.EVALUATIONS), *args])
    known.check(config)
    return config, {"rows": rows}


def _ladder(known: ModuleType, args: list[str], quick: bool, load: Loader):
    from gril_jax.workflows.study.rows import chosen_rows

    name, steps = positional(args), whole_number(args, "--steps-per-encoder", None)
    names = take(args, "--rows")
    config = load(name or "match_regions", args)
    known.check(config)
    every = known.of_task(config.env.name)
    require_left_to_options(args, known.paths(every))
    return config, {"rows": known.with_steps(chosen_rows(names, every), steps)}


def _suite(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, films = positional(args), take(args, "--films")
    if name not in (None, "magical"):
        raise ConfigError(f"{name!r} is no suite that is known; it must be magical")
    sets = Path(take(args, "--sets") or "runs/magical_sets")
    if films is not None:
        existing_folder(films)
    names = [*_rows_taken(known, args, known.USUAL)]
    taken = {path for change in known.ROWS.values() for path in change} - {"ppo.num_timesteps"}
    require_left_to_options(args, taken)
    config = load("magical_suite", args)
    rows = known.rows(sets, config.ppo.num_timesteps)
    return config, {"rows": {name: rows[name] for name in names}, "films": films}


def _table2(known: ModuleType, args: list[str], quick: bool, load: Loader):
    from gril_jax.workflows.study.rows import require_learned

    name, every = positional(args), not quick and not any(arg.startswith("--rows") for arg in args)
    rows = _rows_taken(known, args, known.QUICK_ROWS if quick else None)
    usual = known.QUICK if quick else known.USUAL if name is None else {}
    # what is said on the command line counts for more
    args = [f"--{path}={value}" for path, value in usual.items()] + args
    config = load(name or "shoes_in_box", args)
    require_learned(config)
    return config, {"rows": known.usable(config, echo) if every else rows}


def _table3(known: ModuleType, args: list[str], quick: bool, load: Loader):
    name, steps = positional(args), whole_number(args, "--steps-per-encoder", None)
    rows, sets = known.with_steps(_rows_taken(known, args), steps), take(args, "--sets")
    require_left_to_options(args, known.paths())
    config = known.with_sets(load(name or "tabletop", args), sets)
    known.check(config, rows)
    return config, {"rows": rows}


VERBS = (
    _table(
        "ablate",
        "which choices of the reward's training matter, over seeds",
        "Change each choice of encoder training alone.",
        _ROWS | _SEEDS,
        _ablate,
    ),
    _table(
        "soundness",
        "the same by audits and by policies, and whether audits tell success; "
        "--resume RUN goes on, --join RUN,RUN makes one table",
        "Train encoders in several ways, audit them, and train a policy with each.",
        _ROWS
        | _SEEDS
        | _AUDIT
        | {
            "--steps-per-policy N": "Control steps of each policy, 0 for none. (default: the "
            "configuration's)",
            "--policies-at-once N": "Policies in one program, at most. (default: 25)",
        },
        _soundness,
    ),
    _table(
        "table1",
        "the paper's Table I and Figure 2: policies with rewards of all kinds; "
        "--quick on a laptop, --resume RUN goes on",
        "Train policies with rewards of several kinds, alike in all else: the paper's Table I and "
        "Figure 2. Learned rewards are audited.",
        _ROWS
        | _SEEDS
        | _STEPS
        | _AUDIT
        | {"--quick": "Two rows with two seeds of the configuration quickstart."},
        _table1,
    ),
    _table(
        "ladder",
        "the same policies given less and less help beside the videos; --resume RUN",
        "Train policies with rewards of several kinds, each at four levels of help: the task's own "
        "starts alone (A), also moments that the policy itself has reached (B) or that the videos "
        "show (V), and what only somebody who knows the goal can give (C).",
        {"--rows A,B": "Names of rows, such as 'ours at level V'. (default: all)"}
        | _SEEDS
        | _STEPS,
        _ladder,
    ),
    _table(
        "suite",
        "all tasks of MAGICAL from films to policies: --films FOLDER; --resume RUN goes on",
        "For each of MAGICAL's eight tasks: find the objects in its films, learn a reward, audit "
        "it, train policies in Demo, and play them in every variant.",
        {
            "--films FOLDER": "Films, in one folder a task; without it, the sets must be there.",
            "--rows A,B": "Names of rows, such as 'find_dupe from films in layout'. (default: of "
            "each task films, films in all, its score)",
        }
        | _SEEDS
        | {
            "--sets FOLDER": "Where the demonstration sets go. (default: runs/magical_sets)",
            "--eval-starts N": "Starts of each evaluation in a variant. (default: 64)",
        },
        _suite,
        help_page.TASKS,
    ),
    _table(
        "table2",
        "the paper's Table II: rewards that tell success from failure; --quick, --resume RUN",
        "Train encoders in several ways, and measure how well their rewards tell success from "
        "failure: the paper's Table II.",
        {"--rows A,B": "Names of rows. (default: all that the configuration allows)"}
        | _SEEDS
        | {"--quick": "Two seeds of the rows without pictures, from fewer demonstrations."},
        _table2,
    ),
    _table(
        "table3",
        "policies for the long tasks at the table, with rewards of all kinds; --resume RUN",
        "Train policies for each of the long tasks at the table with rewards of several kinds.",
        {"--rows A,B": "Names of rows, such as 'ours on umbrella_out'. (default: all)"}
        | _SEEDS
        | _STEPS
        | {
            "--sets FOLDER": "Demonstration sets, each in a folder of its task's name; without it "
            "they are made."
        },
        _table3,
        help_page.TASKS,
    ),
)
