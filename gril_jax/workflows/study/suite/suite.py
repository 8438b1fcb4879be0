"""A suite of tasks from films alone: for each a reward, its audit, policies, and all variants.

    gril suite magical --films FOLDER              eight tasks, learned rewards and the score as one
    gril suite magical --films FOLDER --rows "find_dupe from films" --seeds 1

For each row and seed an encoder is trained on films where the row learns a reward, and audited, and
a policy is trained, in the variant Demo or in the row's own; then it plays every variant. Writes
`suite.md` and `suite.csv` (a line a policy) after each program, the rewards as
`rewards/TASK-SEED.npz`, a film of a policy of each row as `films/ROW.mp4`, and `suite.png` and
`report.html` at the end.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from gril_jax.demos.importing import import_videos
from gril_jax.demos.magical_pickles import HALF_EXTENT
from gril_jax.demos.vision.video import write_video
from gril_jax.report import html
from gril_jax.report.figures.style import WIDTH, styled
from gril_jax.report.rates import UNKNOWN
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.run_dir import RunDir
from gril_jax.workflows.build import filming
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.counted import Counted, solved
from gril_jax.workflows.study.curves import LAST, Curve, at_the_end, draw_spread
from gril_jax.workflows.study.measures import TAU, Measure
from gril_jax.workflows.study.page import facts
from gril_jax.workflows.study.programs import Program
from gril_jax.workflows.study.results import Found, Table
from gril_jax.workflows.study.written import Column, Line, Section, column, markdown, mean_range

from . import rewards, variants
from .rows import ROWS, Settings, films_of, parts

_LINE = "make_line"  # its score counts a clump as a line
_VARIANTS = ("demo", "jitter", "color", "shape", "layout", "countplus", "dynamics", "all")
_PLAYED = tuple(f"{what}_{v}" for v in _VARIANTS for what in ("success", "score", "sampled"))
_MORE = ("clumped_demo", "episodes_demo")
_COLUMNS = ("row", "seed", *LAST, "steps_80", "seconds", *rewards.FIGURES, *_PLAYED, *_MORE)


def _prepare(settings: Settings, echo: Callable[[str], None]) -> None:
    """Makes the demonstration sets that are missing, from their films."""
    for change in settings.rows.values():
        task, out = change["env.name"], Path(change["demos.path"])
        if (out / "demos.json").is_file() or settings.films is None:
            continue
        folder = films_of(Path(settings.films), task)
        echo(f"finding the objects in the films of {folder}")
        out.parent.mkdir(parents=True, exist_ok=True)
        import_videos(folder, out, boxes="colour", half_extent=HALF_EXTENT, task=task)


def _policy(curve: Curve) -> dict[str, float]:
    return at_the_end(curve) | {"seconds": float(curve.seconds[-1])}


def _after(
    programs: Sequence[Program], settings: Settings, pool: Executor
) -> Callable[[Program, RunDir], None]:
    """The step after a program's training: its policies play every variant."""
    ready = {
        one.name: variants.submit(one.rows[0].config, len(one.rows), settings.eval_starts, pool)
        for one in programs
    }

    def finish(program: Program, run: RunDir) -> None:
        # A row's policies are one program: none of them is too large for a device.
        config, count = program.rows[0].config, len(program.rows)
        on = ready.pop(program.name).result()
        saved = checkpoint.latest(run.path / "policies" / program.name)
        policies = checkpoint.restore(saved, variants.like(config, on.env, count))
        found, played = variants.figures(on, policies)
        each = [
            {"seed": row.seed, "episodes_demo": settings.eval_starts}
            | {name: values[i] for name, values in found.items()}
            for i, row in enumerate(program.rows)
        ]
        if config.env.name != _LINE:
            each = [{n: x for n, x in one.items() if not n.startswith("clumped")} for one in each]
        best = int(np.argmax(found["score_demo"]))
        folder = run.path / "films"
        folder.mkdir(exist_ok=True)
        data = jax.tree.map(lambda x: x[best], played.data)
        film = folder / f"{_file(parts_of(program, settings))}.mp4"
        write_video(film, filming.outlines(on.env, data), on.env.control_hz)
        cell = program.rows[0].cell
        run.finish_phase(f"variants-{cell}", {"seeds": each}, [film])

    return finish


def parts_of(program: Program, settings: Settings) -> str:
    """The row of a program."""
    return [*settings.rows][program.rows[0].cell]


def _file(row: str) -> str:
    return row.replace(" ", "-")


def _measures(config, settings: Settings, demos: Demonstrations | None) -> list[Measure]:
    return [TAU, rewards.audit(settings), rewards.files()]


def _of_policies(values, count: int) -> str:
    return solved(values, count)


def _sections(among: str) -> list[Section]:
    played = [Column(f"score_{name}", name.capitalize(), mean_range) for name in _VARIANTS]
    return [
        Section(
            "Rewards: Kendall's tau on films kept aside, and the audit from Demo.",
            [
                Column("tau", "tau"),
                Column("hack_gap", "hack gap"),
                Column("order", "order"),
                Column("push", "for pushing anywhere"),
            ],
        ),
        Section(
            f"Policies in Demo: {among}.",
            [
                Column("success_demo", "solved, deterministic actions", _of_policies),
                Column("sampled_demo", "success, sampled actions"),
                Column("score_demo", "score, deterministic actions"),
                Column("seconds", "seconds of all its policies", lambda x, n: f"{x.max():.0f}"),
            ],
        ),
        Section("The same policies in all variants: score, deterministic actions.", played),
        Section(
            "Share of episodes in Demo that end with all blocks in a clump, which counts, too.",
            [Column("clumped_demo", "in a clump")],
        ),
    ]


def _text(found: Found) -> str:
    return markdown(found.lines, _sections(_in_demo(found.lines)))


def _in_demo(lines: Sequence[Line]) -> str:
    """The starts behind success in Demo, which has a single one."""
    played = column(lines, "episodes_demo")
    known = played[np.isfinite(played)]
    return Counted(int(known[0]), 1).in_words("demo", sampled=True) if len(known) else UNKNOWN


def _figure(found: Found) -> Figure | None:
    return _panels(found.names, found.curves) if found.curves else None


@styled
def _panels(names: Sequence[str], found: Sequence[Curve]) -> Figure:
    """Score against steps: a panel for each task, in it a line for each reward."""
    of: dict[str, dict[str, list[Curve]]] = {}
    for curve in found:
        task, reward = parts(names[curve.cell])
        of.setdefault(task, {}).setdefault(reward, []).append(curve)
    across = 4
    down = -(-len(of) // across)
    drawn = Figure(figsize=(WIDTH, 0.3 * WIDTH * down + 0.4), layout="constrained")
    panels = np.ravel(drawn.subplots(down, across, sharey=True, squeeze=False))
    kinds = [*dict.fromkeys(reward for each in of.values() for reward in each)]
    for panel, (task, each) in zip(panels, of.items(), strict=False):
        for reward, curves in each.items():
            steps = np.mean([[0.0, *curve.env_steps] for curve in curves], axis=0) / 1e6
            score = np.stack([[0.0, *curve.scores["score_sampled"]] for curve in curves])
            draw_spread(panel, steps, score, number=kinds.index(reward), label=reward)
        panel.set_title(task, fontsize=9)
        panel.set_ylim(-0.03, 1.03)
    for panel in panels[len(of) :]:
        panel.set_axis_off()
    drawn.supxlabel("million env steps", fontsize=10)
    drawn.supylabel("score, Jitter starts, sampled actions", fontsize=10)
    shown = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    if len(kinds) > 1:
        drawn.legend(shown.values(), shown, loc="outside upper center", ncols=3)
    return drawn


def _page(found: Found, figure: bytes, folder: Path) -> str:
    films = []
    for name in found.names:
        file = folder / "films" / f"{_file(name)}.mp4"
        if file.is_file():
            films.append(html.Part(name, file.read_bytes(), f"A policy of {name}", "video/mp4"))
    curves = html.Part("Score while policies are trained", figure, "Learning curves", wide=True)
    return html.render(
        title="A suite of tasks from films",
        summary="For each task a reward learned from films, its audit, and policies in Demo and in "
        "every variant.",
        tiles=[],
        sections=[html.Section("Policies", films), html.Section("Learning", [curves])],
        facts=facts(found),
        tables={},
        listings={"The table as Markdown": _text(found)},
    )


def _summary(found: Found) -> dict[str, Any]:
    return dict(found.about)


def _columns(lines: Sequence[Line]) -> Sequence[str]:
    return _COLUMNS


TABLE = Table(
    "suite",
    columns=_columns,
    text=_text,
    figure=_figure,
    page_in=_page,
    settings=Settings,
    prepare=_prepare,
    plan=lambda rows, settings, programs: programs(rows),
    policy=_policy,
    measured={"tau": ("tau",), "audit": rewards.FIGURES, "variants": (*_PLAYED, *_MORE)},
    measures=_measures,
    order=[*ROWS],
    newer=[*rewards.FIGURES, *_PLAYED, *_MORE, "tau"],
    summary=_summary,
    one_set=False,
    after=_after,
)
