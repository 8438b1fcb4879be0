"""What a study writes for people: a Markdown table, a CSV, a figure and a page."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gril_jax.errors import RunError
from gril_jax.report import html
from gril_jax.report.curves import spread, success_failure
from gril_jax.report.style import png
from gril_jax.report.headline import Tile
from gril_jax.report.html import Part
from gril_jax.runs import run_dir

from . import results, saved
from .columns import among, order_of_starts, sections
from .curves import learning_curves
from .results import PASSES, Found
from .written import Line, Section, by_row, cells, csv, markdown, with_published

NAMES = ("study.md", "study.csv", "study.png", "report.html")

_MOST = 4  # tiles
# What is shown of rewards where no policies are: the first that is known.
_DOTS = {
    "rho_held": "rho of held-out recordings, held to one length; lower is better",
    "tau": "tau on held-out videos",
}


def write(folder: Path, *, last: bool = True) -> Found:
    """Table and lines of what a study's files hold; with `last` the picture and the page, too."""
    found = results.read(folder)
    files = {NAMES[0]: f"{text(found)}\n".encode(), NAMES[1]: _csv(found).encode()}
    drawn = figure(found) if last else None
    if drawn is not None:
        files[NAMES[2]] = png(drawn)
        files[NAMES[3]] = page(found, files[NAMES[2]], folder).encode()
    with run_dir.writing(folder):
        for name, contents in files.items():
            (folder / name).write_bytes(contents)
    return found


def redraw(folder: Path, echo: Callable[[str], None] = print) -> None:
    """Writes all of a study again, from its files alone; RunError if nothing has finished."""
    if not write(folder).lines:
        raise RunError(f"{folder} has nothing that has finished, so its table is still empty")
    echo(f"report: {folder / NAMES[3]}")


def text(found: Found) -> str:
    """The table as Markdown, and what failed."""
    lines = with_published(found.lines, found.plan.study.published)
    failed = [f"The row {name!r} failed: {said}." for name, said in found.failed.items()]
    parts = [markdown(lines, sections(found)), found.about.get("given"), *failed]
    return "\n\n".join(filter(None, parts))


def _csv(found: Found) -> str:
    return csv(found.lines, found.columns)


def figure(found: Found) -> Figure | None:
    """Success while policies are trained; without policies a dot for each reward, by row. None
    before there is anything to draw."""
    if found.curves:
        return learning_curves(found.names, found.curves)
    for name, label in _DOTS.items():
        if any(name in line for line in found.lines):
            return spread(by_row(found.lines, name), label)
    return None


def page(found: Found, picture: bytes, folder: Path) -> str:
    """The page, as one self-contained file."""
    study = found.plan.study
    lines = with_published(found.lines, study.published)
    tables = [*filter(None, (_table(lines, one) for one in sections(found)))]
    body = [html.Section("Results", tables)]
    caption = "Each dot is a reward; a bar is at their mean."
    if found.curves:
        caption = (
            "Success with sampled actions while policies are trained, the interquartile mean over "
            f"policies within their quartiles, {_counted(found)}."
        )
    body.insert(1, html.Section("Figure", [Part(caption, picture, "Figure", wide=True)]))
    if parts := [*_profiles(found), *_films(found, folder)]:
        body.append(html.Section("Rewards and policies", parts))
    if found.failed:
        said = [
            html.Step(f"{name}: {why}.", _alone(found, name)) for name, why in found.failed.items()
        ]
        body.insert(0, html.Section("Failed rows", steps=said))
    row = next(iter(found.plan.work), "ROW")
    steps = [
        html.Step("Train one row by itself.", _alone(found, row)),
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


def _alone(found: Found, name: str) -> str:
    return saved.command(found.plan, Path("RUN"), name)


def _table(lines: Sequence[Line], section: Section) -> html.Table | None:
    """A section; in a cell the number, and below it what follows: `84.4; 84.4 (71.9 to 96.9)`. Rows
    and columns of which nothing is known are left out; None if that is all."""
    of = {row: texts for row, texts in cells(lines, section.columns).items() if any(texts)}
    known = [i for i in range(len(section.columns)) if any(texts[i] for texts in of.values())]
    split = {
        row: [html.Cell(*re.split(r"; | (?=\()", texts[i], maxsplit=1)) for i in known]
        for row, texts in of.items()
    }
    heads = [section.columns[i].heading for i in known]
    return html.Table(section.caption, heads, split) if heads else None


def _counted(found: Found) -> str:
    (variant, suffix), *_ = order_of_starts(found)
    return among(found, variant, suffix, sampled=True)


def _of_rows(found: Found) -> dict[str, np.ndarray]:
    """Success of each row's policies, with sampled actions, from the starts that tell most."""
    name = f"success{order_of_starts(found)[0][1]}_sampled"
    known = {row: x[np.isfinite(x)] for row, x in by_row(found.lines, name).items()}
    return {row: x for row, x in known.items() if len(x)}


def _tiles(found: Found) -> list[Tile]:
    """The best rows, each with the spread of its policies, and the audits of all rewards."""
    of = _of_rows(found)
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


def _profiles(found: Found) -> list[Part]:
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
            parts.append(Part(caption, drawn, f"Rewards along demonstrations: {row}"))
    return parts


def _films(found: Found, folder: Path) -> list[Part]:
    files = saved.row_files(folder, found.names)
    films = {name: folder / "films" / f"{files[name].stem}.mp4" for name in found.plan.work}
    return [
        Part(name, film.read_bytes(), f"A policy of {name}", "video/mp4")
        for name, film in films.items()
        if film.is_file()
    ]
