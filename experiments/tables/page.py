"""What the pages of tables have in common: sections as tables of HTML, and what was run."""

import re
from collections.abc import Mapping, Sequence

from gril_jax.report import html

from .results import Found
from .written import Line, Section, cells


def page_table(lines: Sequence[Line], section: Section) -> html.Table:
    """A section; in a cell the number, and below it what follows: `84.4; 84.4 (71.9 to 96.9)`."""
    split = {
        row: [html.Cell(*re.split(r"; | (?=\()", cell, maxsplit=1)) for cell in texts]
        for row, texts in cells(lines, section.columns).items()
    }
    return html.Table(section.caption, [one.heading for one in section.columns], split)


def facts(found: Found) -> dict[str, str]:
    """What was run, in a few words each."""
    return {k: str(x) for k, x in found.about.items() if not isinstance(x, Mapping)}


def versions(found: Found) -> dict[str, str]:
    """Package to version."""
    return {str(k): str(x) for k, x in found.about.get("packages", {}).items()}
