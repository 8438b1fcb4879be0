"""Parts that pages of tables share: sections as tables of HTML, dots of policies, versions."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from gril_jax.report import html
from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import png

from .results import Found
from .written import Line, Section, cells


def page_table(lines: Sequence[Line], section: Section) -> html.Table:
    """A section; in a cell the number, and below it what follows: `84.4; 84.4 (71.9 to 96.9)`."""
    split = {
        row: [html.Cell(*re.split(r"; | (?=\()", cell, maxsplit=1)) for cell in texts]
        for row, texts in cells(lines, section.columns).items()
    }
    return html.Table(section.caption, [one.heading for one in section.columns], split)


def dots(of: Mapping[str, np.ndarray], label: str, counted: str, kind: str) -> html.Part:
    """A picture of each policy's success, by row; `counted` are its starts, `kind` a row's name."""
    return html.Part(
        f"A dot for each policy, {counted}, and a bar at their mean; the dotted line is the first "
        f"{kind}'s mean.",
        png(spread(of, label)),
        f"Success of each {kind}'s policies",
        wide=True,
    )


def facts(found: Found) -> dict[str, str]:
    """Facts of the run, in a few words each: command, device, date."""
    return {k: str(x) for k, x in found.about.items() if not isinstance(x, Mapping)}


def versions(found: Found) -> dict[str, str]:
    """Package to version."""
    return {str(k): str(x) for k, x in found.about.get("packages", {}).items()}
