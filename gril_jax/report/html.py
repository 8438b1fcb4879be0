"""Renders a report as one self-contained HTML file, with its pictures and videos.

Every text that reaches the page is escaped here, wherever it came from. The frame of the page is
`page.html`; its policy forbids scripts and any address but its own data.
"""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import NamedTuple

from gril_jax.safe_files import write_whole, writing

from .headline import Tile, Verdict


class Part(NamedTuple):
    """A picture or video with its caption; or only a sentence if `contents` is None."""

    caption: str
    contents: bytes | None = None
    alt: str = ""  # what is to be seen, for those who cannot
    mime: str = "image/png"  # or "video/mp4"
    wide: bool = False  # as wide as the page, where others stand side by side


class Cell(NamedTuple):
    """An entry of a table, and in small letters below it what belongs to it, such as a range."""

    value: str
    note: str = ""


class Table(NamedTuple):
    """Rows of cells below headings; a table wider than the page scrolls sideways."""

    caption: str
    heads: Sequence[str]  # of the columns of cells
    rows: Mapping[str, Sequence[Cell]]  # as many cells as headings, by the row's name


class Step(NamedTuple):
    """Something to do next: a sentence, the command that does it, or a page that has it."""

    words: str
    command: str = ""
    page: str = ""  # relative to this one


class Section(NamedTuple):
    """A heading and its content."""

    title: str
    parts: Sequence[Part | Table] = ()
    steps: Sequence[Step] = ()


def save(file: Path, contents: bytes) -> bytes:
    """Writes a page or what belongs to it, whole or not at all; returns its contents."""
    with writing(file.parent):
        write_whole(file, contents, durable=False)
    return contents


def render(
    title: str,
    summary: str,
    tiles: Sequence[Tile],
    sections: Sequence[Section],
    facts: Mapping[str, str],
    tables: Mapping[str, Mapping[str, str]],
    listings: Mapping[str, str],
    *,
    verdict: Verdict | None = None,
    film: Part | None = None,
    beside: Sequence[Part] = (),
    more: Sequence[Tile] = (),
) -> str:
    """The page.

    Args:
      title, summary: its heading, and its name in the browser; a sentence below the heading.
      tiles: the numbers at the top.
      facts: short lines of what was run.
      tables, listings: values by name, and longer texts, each folded under its title.
      video: on the first screen, on a phone's, too.
      beside: on the first screen of a desk: what belongs below the video, and what to its right.
      more: numbers that can wait until what was run is told.
    """
    body = [
        '<header class="top">',
        f"<div><h1>{escape(title)}</h1>",
        f"<p>{escape(summary)}</p></div>",
        f'<p class="verdict {verdict.grade}">{escape(verdict.text)}</p>' if verdict else "",
        "</header>",
        '<div class="first">' if film else "",
        f'<div class="film">{_part(film)}</div>' if film else "",
        _tiles(tiles),
        *(f"<div>{_part(part)}</div>" for part in beside),
        "</div>" if film else "",
        *map(_section, sections),
        "<section><h2>What was run</h2>",
        _tiles(more),
        _table(facts, "facts"),
        *(_folded(name, _table(rows, "values")) for name, rows in tables.items()),
        *(_folded(name, f"<pre>{escape(text)}</pre>") for name, text in listings.items()),
        "</section>",
    ]
    content = "\n".join(piece for piece in body if piece)
    page = (resources.files("gril_jax.report") / "page.html").read_text(encoding="utf-8")
    return Template(page).substitute(title=escape(title), body=content)


def _tiles(tiles: Sequence[Tile]) -> str:
    if not tiles:
        return ""
    texts = (map(escape, tile) for tile in tiles)
    cells = "\n".join(f"<div><b>{v}</b>{label}<small>{n}</small></div>" for v, label, n in texts)
    return f'<div class="tiles">\n{cells}\n</div>'


def _section(section: Section) -> str:
    parts = "\n".join(map(_part, section.parts))
    head = f"<section><h2>{escape(section.title)}</h2>"
    inner = f'\n<div class="parts">\n{parts}\n</div>' if parts else ""
    return f"{head}{inner}{_steps(section.steps)}</section>"


def _steps(steps: Sequence[Step]) -> str:
    if not steps:
        return ""
    items = []
    for step in steps:
        words, page = escape(step.words), escape(step.page)
        link = f'<a href="{page}">{words}</a>' if page else words
        items.append(f"<li>{link}" + f"<code>{escape(step.command)}</code>" * bool(step.command))
    return '\n<ul class="steps">\n' + "\n".join(f"{item}</li>" for item in items) + "\n</ul>"


def _part(part: Part | Table) -> str:
    if isinstance(part, Table):
        return _wide_table(part)
    if part.contents is None:
        return f'<p class="absent">{escape(part.caption)}</p>'
    source = f"data:{part.mime};base64,{base64.b64encode(part.contents).decode('ascii')}"
    alt = escape(part.alt)
    media = (
        f'<label class="zoom"><input type="checkbox" aria-label="Enlarge: {alt}">'
        f'<img src="{source}" alt="{alt}"></label>'
    )
    if part.mime.startswith("video/"):
        label = f'aria-label="{escape(part.alt)}" controls autoplay loop muted playsinline'
        media = f'<video src="{source}" {label}></video>'
    size = ' class="whole"' if part.wide else ""
    return f"<figure{size}>{media}<figcaption>{escape(part.caption)}</figcaption></figure>"


def _wide_table(table: Table) -> str:
    """A table in a box that takes keyboard focus, so that the arrow keys scroll it as well."""
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in table.heads)
    rows = "\n".join(
        f'<tr><th scope="row">{escape(name)}</th>'
        + "".join(_cell(cell) for _, cell in zip(table.heads, cells, strict=True))
        + "</tr>"
        for name, cells in table.rows.items()
    )
    caption = escape(table.caption)
    return (
        '<figure class="whole">'
        f'<div class="wide" tabindex="0" role="region" aria-label="{caption}">'
        f"<table>\n<thead><tr><td></td>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>"
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _cell(cell: Cell) -> str:
    note = f"<small>{escape(cell.note)}</small>" if cell.note else ""
    return f"<td>{escape(cell.value)}{note}</td>"


def _table(rows: Mapping[str, str], kind: str) -> str:
    cells = "\n".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items()
    )
    return f'<table class="{kind}">\n{cells}\n</table>' if rows else ""


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{escape(title)}</summary>{content}</details>" if content else ""
