"""What a study writes for people: a Markdown table, a CSV, a figure and a page.

Shapes use n for the points of a line.
"""

import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from gril_jax.errors import RunError, ShapeError
from gril_jax.metrics.order import interquartile_mean
from gril_jax.report import html
from gril_jax.report.curves import spread, success_failure
from gril_jax.report.headline import Tile
from gril_jax.report.style import COLOURS, GREY, WIDTH, png, shortened, styled
from gril_jax.runs import run_dir
from gril_jax.safe_files import write_whole

from . import predictors, results, saved, table
from .results import PASSES, Curve, Found

NAMES = ("study.md", "study.csv", "study.png", "report.html")

_MOST = 4  # tiles
_PANELS = 3  # in a row of the figure
_TITLE = 34  # letters in a line of a panel's title
# What is shown of rewards where no policies are: the first that is known.
_DOTS = {
    "rho_held": "rho of held-out recordings, held to one length; lower is better",
    "tau": "tau on held-out videos",
}


def write(folder: Path, *, last: bool = True) -> Found:
    """Table and lines of what a study's files hold; with `last` the picture and the page, too."""
    found = results.read(folder)
    files = {NAMES[0]: f"{text(found)}\n".encode(), NAMES[1]: found.csv.encode()}
    drawn = figure(found) if last else None
    if drawn is not None:
        files[NAMES[2]] = png(drawn)
        files[NAMES[3]] = page(found, files[NAMES[2]], folder).encode()
    with run_dir.writing(folder):
        for name, contents in files.items():
            write_whole(folder / name, contents, durable=False)
    return found


def redraw(folder: Path, echo: Callable[[str], None] = print) -> None:
    """Writes all of a study again, from its files alone; RunError if nothing has finished."""
    if not write(folder).lines:
        raise RunError(f"{folder} has nothing that has finished, so its table is still empty")
    echo(f"report: {folder / NAMES[3]}")


def text(found: Found) -> str:
    """The table as Markdown, and what failed."""
    failed = [f"The row {name!r} failed: {said}." for name, said in found.failed.items()]
    shown = table.markdown(_parts(found))
    return "\n\n".join(filter(None, [shown, found.about.get("given"), *failed]))


def _parts(found: Found) -> list[table.Part]:
    shown = table.parts(found.lines, table.sections(found))
    return [*shown, *(predictors.part(x) for x in [predictors.of(found)] if x)]


# --- the figure


def figure(found: Found) -> Figure | None:
    """Success while policies are trained; without policies a dot for each reward, by row. None
    before there is anything to draw."""
    if found.curves:
        return learning_curves(found.names, found.curves)
    for name, label in _DOTS.items():
        if any(name in line for line in found.lines):
            return spread(table.by_row(found.lines, name), label)
    return None


@styled
def learning_curves(names: Sequence[str], found: Sequence[Curve]) -> Figure:
    """Success with sampled actions against env steps, a panel for each row that has policies, with
    the first row's line dotted; ShapeError without a curve."""
    if not found:
        raise ShapeError("found is empty; it must hold at least one curve.")
    rows: dict[str, list[Curve]] = {}
    for curve in sorted(found, key=lambda curve: curve.cell):
        rows.setdefault(names[curve.cell], []).append(curve)
    across = min(_PANELS, len(rows))
    down = math.ceil(len(rows) / across)
    drawn = Figure(figsize=(WIDTH, 1.75 * down + 0.4 if down > 1 else 0.5 * WIDTH))
    panels = drawn.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    for number, (name, members) in enumerate(rows.items()):
        steps = np.mean([[0.0, *curve.env_steps] for curve in members], axis=0) / 1e6
        scores = [x.scores[f"success{x.headline}_sampled"] for x in members]
        success = np.stack([[0.0, *values] for values in scores])
        draw_spread(panels[number], steps, success, number=number, label=shortened(name))
        panels[number].set_title(
            textwrap.fill(shortened(name), _TITLE, break_on_hyphens=False), fontsize=10
        )
        if number:
            panels[number].plot(*panels[0].lines[0].get_data(), ":", color=GREY)
    for number, panel in enumerate(panels):
        panel.xaxis.set_tick_params(labelbottom=number + across >= len(rows))
        if number >= len(rows):
            panel.set_axis_off()
    panels[0].set_ylim(-0.03, 1.03)
    drawn.supxlabel("env steps of each policy, millions", fontsize=10)
    drawn.supylabel("success, sampled actions", fontsize=10)
    drawn.set_layout_engine("constrained")
    return drawn


def draw_spread(
    axes: Any,
    x: Float[np.ndarray, "n"],
    curves: Float[np.ndarray, "seeds n"],
    *,
    number: int,
    label: str,
) -> None:
    """A line at the interquartile mean over seeds, within a band from quartile to quartile.

    The mean is left out: one seed that fails or excels can carry it outside of the quartiles, where
    the interquartile mean never is. Each number up to 24 has a look of its own.
    """
    colour = COLOURS[number % len(COLOURS)]
    style = ("-", "--", ":", "-.")[number // len(COLOURS) % 4]
    middle = jax.vmap(interquartile_mean, in_axes=1)(jnp.asarray(curves, jnp.float32))
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, np.asarray(middle), style, color=colour, label=label)


# --- the page


def page(found: Found, picture: bytes, folder: Path) -> str:
    """The page, as one self-contained file."""
    study = found.plan.study
    alone = lambda name: saved.command(found.plan, Path("RUN"), name)  # noqa: E731
    body = []
    if found.failed:
        said = [html.Step(f"{name}: {why}.", alone(name)) for name, why in found.failed.items()]
        body.append(html.Section("Failed rows", steps=said))
    body.append(html.Section("Results", [_table(one) for one in _parts(found)]))
    caption = "Each dot is a reward; a bar is at their mean."
    if found.curves:
        caption = (
            "Success with sampled actions while policies are trained, the interquartile mean over "
            f"policies within their quartiles, {_counted(found)}; dotted: that of the first row."
        )
    figures = [html.Part(caption, picture, "Figure", wide=True)]
    if known := predictors.of(found):
        said = "Correlation of each measure of a reward with its policy's success, 95 % intervals."
        figures.append(html.Part(said, png(predictors.figure(known)), "Measures", wide=True))
    body.append(html.Section("Figure", figures))
    if pictures := [*_profiles(found), *_films(found, folder)]:
        body.append(html.Section("Rewards and policies", pictures))
    steps = [
        html.Step("Train one row by itself.", alone(next(iter(found.plan.work), "ROW"))),
        html.Step("Go on where it was cut off.", "gril sweep --resume RUN"),
    ]
    body.append(html.Section("What next", steps=steps))
    facts = {k: str(x) for k, x in found.about.items() if not isinstance(x, Mapping)}
    versions = {str(k): str(x) for k, x in found.about.get("packages", {}).items()}
    return html.render(
        title=f"Study {study.name}",
        summary=f"{study.about} {found.about.get('given', '')}".strip(),
        tiles=_tiles(found),
        sections=body,
        facts=facts,
        tables={"Package versions": versions},
        listings={"The table as Markdown": text(found)},
    )


def _table(part: table.Part) -> html.Table:
    """In a cell the number, and below it what follows: `84.4; 84.4 (71.9 to 96.9)`."""
    split = {
        row: [html.Cell(*re.split(r"; | (?=\()", x, maxsplit=1)) for x in texts]
        for row, texts in part.cells.items()
    }
    return html.Table(part.caption, part.headings, split)


def _counted(found: Found) -> str:
    return found.counted(next(iter(found.starts)), sampled=True)


def _tiles(found: Found) -> list[Tile]:
    """The best rows, each with the spread of its policies, and the audits of all rewards."""
    name = f"success{next(iter(found.starts.values()))}_sampled"
    known = {row: x[np.isfinite(x)] for row, x in table.by_row(found.lines, name).items()}
    of = {row: x for row, x in known.items() if len(x)}
    best = sorted(of, key=lambda row: -of[row].mean())[:_MOST]
    tiles = [
        Tile(
            f"{of[row].mean():.1%}",
            row,
            f"{of[row].min():.1%} to {of[row].max():.1%} over {len(of[row])} policies, "
            f"{_counted(found)}",
        )
        for row in best
    ]
    audited = [line[PASSES] for line in found.lines if PASSES in line]
    if audited:
        tiles.append(Tile(f"{sum(audited):.0f} of {len(audited)}", "rewards pass their audit"))
    elif any("tau" in line for line in found.lines):
        note = "--run.audit 300 searches for states that the rewards overestimate"
        tiles.append(Tile("not audited", "the rewards, by their audit", note))
    if found.failed:
        tiles.append(Tile(f"{len(found.failed)} failed", "rows"))
    return tiles


def _profiles(found: Found) -> list[html.Part]:
    parts = []
    for row, of in found.profiles.items():
        success, failure = (
            [np.array(x, float) for x in of[k] if len(x)] for k in ("success", "failure")
        )
        if success and failure:
            caption = (
                f"{row}: the reward along demonstrations kept aside, successful (left) and failed "
                "(right), of the first seed. Successes should end near the top, failures below."
            )
            drawn = png(success_failure(success, failure))
            parts.append(html.Part(caption, drawn, f"Rewards along demonstrations: {row}"))
    return parts


def _films(found: Found, folder: Path) -> list[html.Part]:
    files = saved.row_files(folder, found.names)
    films = {name: folder / "films" / f"{files[name].stem}.mp4" for name in found.plan.work}
    return [
        html.Part(name, film.read_bytes(), f"A policy of {name}", "video/mp4")
        for name, film in films.items()
        if film.is_file()
    ]
