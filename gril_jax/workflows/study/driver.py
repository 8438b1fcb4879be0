"""The driver of every study: it trains, measures, goes on where it stood, and writes.

For each row and seed a reward is learned where the row has a learned one, then measured, and a
policy is trained with it. Seeds share a program, and rows do that compile alike. All that is
written is read from the run's files; it is written again after each program, so that a study that
is cut off leaves what it has.
"""

import contextlib
import dataclasses
import io
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.demos import schema
from gril_jax.demos.importing import import_videos
from gril_jax.demos.magical_pickles import HALF_EXTENT
from gril_jax.errors import ConfigError, DemoError, GrilError, RunError
from gril_jax.runs import hosts, reading, run_dir
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import demonstrations, setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.build.policy_rewards import begins_at_frames

from . import audit, elsewhere, measures, saved, separation, summary, variants
from . import programs as study_programs
from . import rewards as study_rewards
from .measures import Gather
from .programs import learn_policies
from .results import FAILED
from .rewards import TrainedReward, reward_key
from .saved import Plan, Row, learns

Echo = Callable[[str], None]


def make(plan: Plan, *, resume: Path | None = None, echo: Echo = print) -> int:
    """Makes a study, or goes on with the run in the folder `resume`; the exit code, 1 if a row
    failed.

    Of several processes (`gril_jax.runs.hosts`) the first alone keeps what it writes, and speaks.
    A run that goes on has its own plan. Raises ConfigError if there is nothing to do, or if a
    policy does not fit into memory.
    """
    rows = plan.runs
    require_possible(plan, rows, new=resume is None)
    programs = programs_of(plan, rows)
    counts = counts_of(rows, programs)
    with _opened(plan, resume, echo) as (run, progress, echo):
        echo(f"writing to {run.path}: {in_words(counts)}")
        failed = _train(plan, rows, programs, run, progress, echo)
        progress.end_phase()  # or its last line would follow the tables
        if not hosts.is_first():
            return 0
        return finish(run, failed, counts, echo)


def counts_of(rows: list[Row], programs: list[study_programs.Program]) -> dict[str, int]:
    """The numbers of rewards, policies and programs that rows make."""
    return {
        "rewards": len({reward_key(row.config) for row in rows if learns(row.config)}),
        "policies": sum(len(program.rows) for program in programs),
        "programs": len(programs),
    }


def in_words(counts: Mapping[str, int]) -> str:
    """`2 rewards, 1 policy` and so on, without what there is none of."""
    one = {what: what.removesuffix("s") for what in counts} | {"policies": "policy"}
    return ", ".join(f"{n} {one[what] if n == 1 else what}" for what, n in counts.items() if n)


def finish(run: run_dir.RunDir, failed: dict[int, str], counts: dict[str, int], echo: Echo) -> int:
    """Ends a run: without results.json where rows failed, so that --resume tries these again."""
    if failed or run.finished_phase(FAILED):
        run.finish_phase(FAILED, {str(cell): said for cell, said in failed.items()})
    echo("writing table, figure and page")
    found = summary.write(run.path, last=run.path == saved.root(run.path))
    if not failed:
        run.finish(counts)
    echo(summary.text(found))
    echo(f"written to {run.path}")
    for cell, said in failed.items():
        name = found.names[cell]
        alone = saved.command(found.plan, run.path, name)
        echo(f"the row {name!r} failed: {said} (alone: {alone})")
    return 1 if failed else 0


def require_possible(plan: Plan, rows: list[Row], *, new: bool) -> None:
    """Raises ConfigError, before a run begins, if rows cannot be made."""
    if not plan.study.policies and not any(learns(row.config) for row in rows):
        raise ConfigError("no row learns a reward, and the study trains no policies")
    checked = set()
    for row in rows:
        key = _of_set(row.config)
        if new and learns(row.config) and row.config.demos.path and key not in checked:
            checked.add(key)
            env = setup.make_env(row.config.env, training=False)
            demonstrations.require_usable(row.config, env)
    audited = plan.study.measure.get("audit", {})
    if audited.get("ascents"):
        for env in dict.fromkeys(row.config.env for row in rows if learns(row.config)):
            audit.audited_tasks(env, audited.get("variants", (audit.OWN,)))


def programs_of(plan: Plan, rows: list[Row]) -> list[study_programs.Program]:
    """The programs that train the policies of rows."""
    if not plan.study.policies:
        return []
    num_classes = len(setup.make_env(plan.config.env, training=False).classes)
    starts, at_once = tuple(plan.study.evaluate), plan.study.at_once
    return study_programs.programs(rows, num_classes, jax.devices(), starts=starts, at_once=at_once)


@contextlib.contextmanager
def _opened(
    plan: Plan, resume: Path | None, echo: Echo
) -> Iterator[tuple[run_dir.RunDir, Progress, Echo]]:
    """The run, new or to go on with; in all processes but the first a scratch folder, silent."""
    config, shown = plan.config, None
    with hosts.scratch() as scratch:
        if scratch is not None:
            own = dataclasses.replace(config.run, out=str(scratch / "run"), sinks=())
            config, resume = dataclasses.replace(config, run=own), None
            echo, shown = (lambda line: None), io.StringIO()
        opened = {"device": setup.device_in_words(), "experiment": saved.EXPERIMENT}
        first = partial(saved.write, plan=plan._replace(config=config))
        with (
            run_dir.create_or_resume(config, resume, **opened, first=first) as run,
            Progress(stream=shown) as progress,
        ):
            for sentence in run.said:
                echo(sentence)
            yield run, progress, echo


def _train(plan: Plan, rows, programs, run, progress, echo: Echo) -> dict[int, str]:
    """Rewards, measures and policies, in the order in which programs are compiled."""
    finished = hosts.largest([run.finished_phase(one.name) is not None for one in programs])
    left = [one for one, done in zip(programs, finished, strict=True) if not done]
    free = [one for one in left if not any(learns(row.config) for row in one.rows)]
    others = [one for one in left if one not in free]
    _require_same_parts(run.path, run.finished_phase, programs)
    learned: dict[Hashable, TrainedReward] = {}
    failed: dict[int, str] = {}
    gather = _gatherer(plan.config, plan.runs, run, progress)

    def written() -> None:
        if hosts.is_first():
            summary.write(run.path, last=False)

    first_seed = plan.config.run.seed

    def learn(one) -> None:
        found = study_rewards.learn(one, run, progress, echo)
        learned.update(found)
        lost = [found[reward_key(row.config)].diverged for row in one.rows]
        said = {i: sentence for i, sentence in enumerate(lost) if sentence}
        _note_seeds(failed, one.rows, said, first_seed)

    def train(program) -> None:
        shown = lambda config: gather(config).batch("train")  # noqa: E731
        compiled = ready.pop(program.name)  # which is kept while it trains
        done, saved_files = learn_policies(program, compiled, learned, shown, run, progress, echo)
        if program.name in played:
            count = len(program.rows)
            phase = progress.phase("playing all variants", total=count, unit="policies")
            variants.finish(played[program.name].result(), program, plan, run, learned)
            phase.update(count)
        run.finish_phase(program.name, done, saved_files)
        _note_seeds(failed, program.rows, done.get("diverged", {}), first_seed)
        written()

    with ahead.compiling() as pool:
        # First what needs no reward: it keeps the device at work while all else is compiled.
        ready = study_programs.get_ready(free, jax.devices(), pool)
        rows = _with_demonstrations(rows, gather, failed)
        # A row of which a seed diverged for good in a finished program keeps its other seeds.
        for program in programs:
            done = run.finished_phase(program.name) or {}
            _note_seeds(failed, program.rows, done.get("diverged", {}), first_seed)
        wanted = study_rewards.get_ready(rows, gather, pool)
        ready |= study_programs.get_ready(others, jax.devices(), pool)
        played = variants.get_ready(left, plan.study, pool)
        needs = partial(study_rewards.needed, wanted)
        asked = _measures(plan, gather, run.path)
        tasks = [
            *(_task(x, x.programs.reward, frozenset(), learn, x.rows) for x in wanted),
            *measures.tasks(asked, rows, learned, needs, run, pool, progress, written),
            *(
                _task(x, ready[x.name], needs(x.rows), train, x.rows)._replace(bears=True)
                for x in left
            ),
        ]
        note = lambda task, error: _note(failed, task.about, error)  # noqa: E731
        ahead.carry_out(tasks, note if jax.process_count() == 1 else None)  # several fail together
    return failed


def _require_same_parts(
    run: Path,
    finished: Callable[[str], Mapping[str, Any] | None],
    programs: list[study_programs.Program],
) -> None:
    """Raises RunError if a finished program had other policies: with another memory or number of
    devices they are shared out in another way, and some would be trained twice or never."""
    for program in programs:
        done = finished(program.name)
        now = [(row.cell, row.seed) for row in program.rows]
        if done is not None and list(map(tuple, done["rows"])) != now:
            raise RunError(
                f"{run}: {program.name} has finished with {len(done['rows'])} policies, but "
                f"would have {len(now)} here: go on with the memory and the devices that it began "
                "with"
            )


def _measures(plan: Plan, gather: Gather, run: Path) -> list[measures.Measure]:
    """The measures of a study's rewards, for the run in a folder."""
    make: dict[str, Callable[..., measures.Measure]] = {
        "audit": partial(audit.Audit, gather),
        "profiles": partial(measures.Profiles, gather),
        "separation": partial(
            separation.Separation, gather, alone=set(plan.study.measure) == {"separation"}
        ),
        "files": partial(measures.Files, plan, run),
        "elsewhere": elsewhere.Elsewhere,
    }
    asked = [make[kind](**options) for kind, options in plan.study.measure.items() if kind in make]
    return [measures.Tau(), *asked]


# --- demonstrations

_FOLDERS = {"match_regions_magical": "match-regions"}  # of videos, where not by the task's name
_KINDS = "*.pkl.gz", "*.mp4"


def make_sets(configs: Iterable[RunConfig], videos: str | None, echo: Echo) -> None:
    """Makes missing demonstration sets from a folder with a folder of videos for each task.

    Raises DemoError, before any set is made, if videos are missing."""
    for out, (task, folder) in missing_sets(configs, videos).items():
        echo(f"finding the objects in the videos of {folder}")
        out.parent.mkdir(parents=True, exist_ok=True)
        pickles = next(folder.glob(_KINDS[0]), None) is not None
        how = {} if pickles else {"boxes": "colour", "half_extent": HALF_EXTENT}
        import_videos(folder, out, task=task, **how)


def missing_sets(configs: Iterable[RunConfig], videos: str | None) -> dict[Path, tuple[str, Path]]:
    """The demonstration sets to be made, each with its task and the folder of its videos; DemoError
    if videos are missing."""
    sets = {c.demos.path: c.env.name for c in configs if c.demos.path is not None}
    missing = {
        Path(out): task for out, task in sets.items() if not (Path(out) / "demos.json").is_file()
    }
    return {out: (task, _films_of(videos, task, out)) for out, task in missing.items()}


def _films_of(films: str | None, task: str, out: Path) -> Path:
    names = dict.fromkeys([_FOLDERS.get(task, task.replace("_", "-")), task])
    for folder in (Path(films) / name for name in (names if films else ())):
        if any(next(folder.glob(kind), None) for kind in _KINDS):
            return folder
    where = f"{films} has no folder {next(iter(names))} of them" if films else "--videos is missing"
    raise DemoError(f"{out} is no demonstration set, and to make it of videos {where}")


def _task(of: Any, wanted: Any, needs: frozenset[str], do: Callable, rows: Sequence[Row]):
    return ahead.Task(of.name, wanted, needs, partial(do, of), rows)


def _note(failed: dict[int, str], rows: Iterable[Row], error: Exception) -> None:
    """Notes what went wrong with some rows, in a sentence without its full stop; the first error of
    a row counts."""
    first = next(iter(str(error).splitlines()), "").strip().rstrip(".")
    if not isinstance(error, GrilError):
        first = f"{type(error).__name__}: {first}"[:300]
    for row in rows:
        failed.setdefault(row.cell, first)


def _note_seeds(
    failed: dict[int, str], rows: Sequence[Row], sentences: Mapping[Any, str], first_seed: int
) -> None:
    """Notes the seeds that diverged, by their place among rows; the others of a row have not."""
    for place, said in sentences.items():
        row = rows[int(place)]
        failed.setdefault(row.cell, f"seed {first_seed + row.seed}: {said}")


def _with_demonstrations(rows: list[Row], gather: Gather, failed: dict[int, str]) -> list[Row]:
    """The rows whose demonstrations are there, or can be made; the others have failed."""
    for row in rows:
        if learns(row.config) and row.cell not in failed:
            try:
                gather(row.config)
            except Exception as error:
                if jax.process_count() > 1:
                    raise
                _note(failed, [row], error)
    return [row for row in rows if row.cell not in failed]


def _of_set(config: RunConfig) -> Hashable:
    return study_rewards.set_key(config)


def _gatherer(
    base: RunConfig, rows: Sequence[Row], run: run_dir.RunDir, progress: Progress
) -> Gather:
    """Demonstrations for a configuration, each set made once; the run notes the first one.

    Their folders are numbered by the study's rows: which are made first may differ in a run that
    goes on."""
    made: dict[Hashable, Demonstrations] = {}
    needed = [x.config for x in rows if learns(x.config) or begins_at_frames(x.config)]
    numbers = {key: at for at, key in enumerate(dict.fromkeys(map(_of_set, needed)))}

    def gather(config: RunConfig) -> Demonstrations:
        key = _of_set(config)
        if key not in made:
            config = base if key == _of_set(base) else config
            env = setup.make_env(config.env, training=False)
            number = numbers.setdefault(key, len(numbers))
            if not number:
                made[key] = demonstrations.gather_once(config, env, run, progress)
            else:
                folder = run.path / f"demos-{number}"
                reading.require_unchanged(run.path, f"{folder.name}/")
                made[key] = demonstrations.gather(config, env, folder, progress)
                if not config.demos.path:
                    run.cover(folder.name, [folder / schema.HEADER])
        return made[key]

    return gather
