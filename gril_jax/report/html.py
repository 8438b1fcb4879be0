"""Renders a report as one self-contained HTML file, with its pictures and videos.

Every text that reaches the page is escaped here, wherever it came from. The page's own policy
forbids scripts and any address but its own data.
"""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
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


class Section(NamedTuple):
    """A heading and its content."""

    title: str
    parts: Sequence[Part | Table]


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
      tables: of names and values, each folded under its title.
      listings: longer texts such as the configuration, each folded under its title.
      film: on the first screen, on a phone's, too.
      beside: on the first screen of a desk: what belongs below the film, and what to its right.
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
    return _PAGE.format(title=escape(title), style=_STYLE, policy=_POLICY, body=content)


def _tiles(tiles: Sequence[Tile]) -> str:
    if not tiles:
        return ""
    texts = (map(escape, tile) for tile in tiles)
    cells = "\n".join(f"<div><b>{v}</b>{label}<small>{n}</small></div>" for v, label, n in texts)
    return f'<div class="tiles">\n{cells}\n</div>'


def _section(section: Section) -> str:
    parts = "\n".join(
        _wide_table(part) if isinstance(part, Table) else _part(part) for part in section.parts
    )
    head = f"<section><h2>{escape(section.title)}</h2>"
    return f'{head}\n<div class="parts">\n{parts}\n</div></section>'


def _part(part: Part) -> str:
    if part.contents is None:
        return f'<p class="absent">{escape(part.caption)}</p>'
    source = f"data:{part.mime};base64,{base64.b64encode(part.contents).decode('ascii')}"
    media = f'<img src="{source}" alt="{escape(part.alt)}">'
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


_POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'"

_STYLE = """
:root { color-scheme: light dark; --page: #ffffff; --ink: #1f2328; --soft: #59636e;
        --line: #d8dee4; --tile: #f6f8fa;
        --good: #1a7f37; --fair: #9a6700; --bad: #c22732; --open: #59636e; }
@media (prefers-color-scheme: dark) {
  :root { --page: #14171b; --ink: #e6e9ec; --soft: #a2abb4; --line: #343a41; --tile: #1e2328;
          --good: #4ac26b; --fair: #d4a72c; --bad: #ff7b72; --open: #a2abb4; }
  img, video { filter: brightness(.88); }
}
* { box-sizing: border-box; }
body { margin: 0 auto 4rem; max-width: 80rem; padding: 1.1rem 1rem 0; background: var(--page);
       color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.45rem; line-height: 1.25; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .9rem; padding-top: 1.1rem;
     border-top: 1px solid var(--line); }
.top p { margin: .15rem 0 0; color: var(--soft); max-width: 52rem; }
.top .verdict { margin: .8rem 0; padding: .5rem .9rem; color: var(--ink); font-weight: 600;
                background: var(--tile); border-radius: .5rem;
                border-left: .4rem solid var(--open); }
.top .good { border-color: var(--good); }
.top .fair { border-color: var(--fair); }
.top .bad { border-color: var(--bad); }
.first { display: grid; gap: .9rem 1.4rem; }
.first > div { min-width: 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .6rem;
         margin: 1rem 0; }
.first .tiles { margin: 0; }
.film video { max-height: 19.5rem; object-fit: contain; }
.tiles div { background: var(--tile); border-radius: .5rem; padding: .6rem .8rem;
             font-size: .92rem; line-height: 1.35; }
.tiles b { display: block; font-size: 1.5rem; line-height: 1.2; }
small { display: block; color: var(--soft); font-size: .8rem; line-height: 1.35;
        margin-top: .2rem; }
figure { margin: 0; min-width: 0; }
img, video { display: block; width: 100%; height: auto; background: #ffffff;
             border: 1px solid var(--line); border-radius: .5rem; }
img { padding: .35rem; }
figcaption { color: var(--soft); font-size: .88rem; line-height: 1.4; margin-top: .35rem;
             max-width: 52rem; }
.absent { color: var(--soft); margin: 0; padding: 1rem; border: 1px dashed var(--line);
          border-radius: .5rem; }
.parts { display: grid; gap: 1.6rem 1.4rem; align-items: start;
         grid-template-columns: repeat(auto-fill, minmax(min(100%, 30rem), 1fr)); }
.parts > .whole { grid-column: 1 / -1; }
@media (min-width: 64rem) {
  .top { display: flex; gap: 1.4rem; align-items: center; justify-content: space-between;
         margin-bottom: .8rem; }
  .top .verdict { margin: 0; flex: 0 1 36rem; }
  .first { grid-template-columns: 1fr 1fr; grid-template-rows: auto auto 1fr; }
  .first .tiles { grid-area: 1 / 1 / 2 / 3; }
  .first .film { grid-area: 2 / 1; }
  .first .film ~ div:last-child { grid-area: 2 / 2 / 4 / 3; }
}
table { border-collapse: collapse; font-size: .92rem; margin: .5rem 0 1rem; }
th { font-weight: 500; text-align: left; color: var(--soft); vertical-align: top;
     padding: .15rem 1.5rem .15rem 0; white-space: nowrap; }
td { padding: .15rem 0; overflow-wrap: anywhere; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
.wide table { margin: 0; border-collapse: separate; border-spacing: 0; }
.wide th, .wide td { padding: .4rem .9rem; text-align: right; white-space: nowrap;
                     vertical-align: top; border-bottom: 1px solid var(--line); }
.wide thead th { vertical-align: bottom; white-space: normal; min-width: 5rem; }
.wide tbody th, .wide thead td { position: sticky; left: 0; background: var(--page);
                                 padding-left: 0; text-align: left; white-space: normal;
                                 min-width: 7rem; }
.wide tbody th { color: var(--ink); }
.wide small { margin: 0; }
details { border: 1px solid var(--line); border-radius: .5rem; padding: .5rem .9rem;
          margin: .6rem 0; }
summary { cursor: pointer; }
pre { overflow-x: auto; font-size: .85rem; line-height: 1.4; }
"""

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}
</body>
</html>
"""
