"""A report as one HTML file: pictures and videos are inside it, and it loads nothing else.

Every text that reaches the page is escaped here, wherever it came from. The page's own policy
forbids scripts and any address but its own data.
"""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

from .headline import Tile

__all__ = ["Cell", "Part", "Section", "Table", "render"]


class Part(NamedTuple):
    """A picture or video with its caption; or a sentence alone, where `contents` is None."""

    caption: str
    contents: bytes | None = None
    alt: str = ""  # what is to be seen, for those who cannot
    mime: str = "image/png"  # or "video/mp4"
    small: bool = False  # narrower than the page


class Cell(NamedTuple):
    """What stands in a table, and in small letters below it what belongs to it, such as a range."""

    value: str
    note: str = ""


class Table(NamedTuple):
    """Rows of cells below headings; wider than the page, it is scrolled sideways."""

    caption: str
    heads: Sequence[str]  # of the columns of cells
    rows: Mapping[str, Sequence[Cell]]  # as many cells as headings, by the row's name


class Section(NamedTuple):
    """A heading and what stands below it."""

    title: str
    parts: Sequence[Part | Table]


def render(
    title: str,
    summary: str,
    tiles: Sequence[Tile],
    sections: Sequence[Section],
    facts: Mapping[str, str],
    tables: Mapping[str, Mapping[str, str]],
    listings: Mapping[str, str],
) -> str:
    """The page.

    Args:
      title: its heading, and its name in the browser.
      summary: a sentence below the heading.
      tiles: the numbers at the top.
      sections: headings with their pictures, in order.
      facts: short lines of what was run.
      tables: of names and values, each folded under its title.
      listings: longer texts such as the configuration, each folded under its title.
    """
    body = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{escape(summary)}</p>",
        _tiles(tiles),
        *map(_section, sections),
        "<section><h2>What was run</h2>",
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
    cells = "\n".join(
        f"<div><b>{escape(tile.value)}</b>{escape(tile.label)}<small>{escape(tile.note)}</small>"
        "</div>"
        for tile in tiles
    )
    return f'<div class="tiles">\n{cells}\n</div>'


def _section(section: Section) -> str:
    parts = "\n".join(
        _wide_table(part) if isinstance(part, Table) else _part(part) for part in section.parts
    )
    return f"<section><h2>{escape(section.title)}</h2>\n{parts}\n</section>"


def _part(part: Part) -> str:
    if part.contents is None:
        return f'<p class="absent">{escape(part.caption)}</p>'
    source = f"data:{part.mime};base64,{base64.b64encode(part.contents).decode('ascii')}"
    alt = escape(part.alt)
    media = (
        f'<video src="{source}" aria-label="{alt}" controls autoplay loop muted playsinline>'
        "</video>"
        if part.mime.startswith("video/")
        else f'<img src="{source}" alt="{alt}">'
    )
    size = ' class="small"' if part.small else ""
    return f"<figure{size}>{media}<figcaption>{escape(part.caption)}</figcaption></figure>"


def _wide_table(table: Table) -> str:
    """Its box takes the keyboard's focus, so that the arrow keys scroll it, too."""
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in table.heads)
    rows = "\n".join(
        f'<tr><th scope="row">{escape(name)}</th>'
        + "".join(_cell(cell) for _, cell in zip(table.heads, cells, strict=True))
        + "</tr>"
        for name, cells in table.rows.items()
    )
    caption = escape(table.caption)
    return (
        f'<figure><div class="wide" tabindex="0" role="region" aria-label="{caption}">'
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
:root { color-scheme: light dark; --page: #ffffff; --ink: #222222; --soft: #5c5c5c;
        --line: #dcdcdc; --tile: #f5f6f7; }
@media (prefers-color-scheme: dark) {
  :root { --page: #17191c; --ink: #e6e6e6; --soft: #a8a8a8; --line: #3a3d42; --tile: #22252a; }
}
* { box-sizing: border-box; }
body { margin: 2rem auto 4rem; max-width: 60rem; padding: 0 1rem; background: var(--page);
       color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .4rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .8rem; padding-top: 1rem;
     border-top: 1px solid var(--line); }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(13.5rem, 1fr));
         gap: .75rem; margin: 1.5rem 0; }
.tiles div { background: var(--tile); border-radius: .5rem; padding: .8rem 1rem; }
.tiles b { display: block; font-size: 1.65rem; line-height: 1.2; }
small { display: block; color: var(--soft); font-size: .82rem; line-height: 1.35;
        margin-top: .25rem; }
figure { margin: 1.2rem 0 2rem; }
figure.small { max-width: 38rem; }
img, video { display: block; width: 100%; height: auto; background: #ffffff;
             border: 1px solid var(--line); border-radius: .5rem; }
img { padding: .5rem; }
figcaption { color: var(--soft); font-size: .92rem; margin-top: .5rem; max-width: 52rem; }
.absent { color: var(--soft); font-style: italic; }
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
