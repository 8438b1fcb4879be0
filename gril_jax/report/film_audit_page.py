"""The page of an audit of videos alone, and the table of figures that every audit shows."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.audit.scene_reward import Scene
from gril_jax.audit.thresholds import NAMES, Audited

from .audit_maps import state_pictures
from .headline import audit_verdict
from .html import Cell, Part, Section, Table, render, save
from .style import png


def write_videos_report(
    folder: Path,
    scenes: Sequence[tuple[str, Scene]],
    names: Sequence[str],
    results: Mapping[str, Any],
    *,
    half_extent: float,
    title: str,
) -> Path:
    """Writes and returns `report.html` of an audit of videos alone, and its picture beside it.

    Args:
      scenes: titled states to show.
      names: of their objects.
      results: what `audit.json` holds.
    """
    found = Audited("videos", results)
    picture = png(state_pictures(scenes, names, half_extent=half_extent))
    page = render(
        title=title,
        summary=f"This is the {NAMES['videos']}. Its scenes are the first and last frames of "
        "held-out videos, with activity bits set or objects displaced. Its range is that from "
        "first to last frames.",
        verdict=audit_verdict(found),
        tiles=[],
        film=Part(
            "The scenes with the lowest and the highest reward that should be otherwise. Thick "
            "boxes have their activity bit set.",
            save(folder / "scenes.png", picture),
            "A held-out end, and the scene with something out of place of the highest reward",
        ),
        sections=[Section("Figures and thresholds", [figure_table(found)])],
        facts={name: str(value) for name, value in results["settings"].items()},
        tables={"All numbers": {
            name: f"{value:.4f}" for name, value in results.items() if type(value) in (int, float)
        }},
        listings={"audit.json": json.dumps(results, indent=2)},
    )  # fmt: skip
    save(folder / "report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def figure_table(found: Audited) -> Table:
    """The figures of an audit with their thresholds."""
    rows = {
        name: [
            Cell(f"{found.value(name):.3f}", one.unit),
            Cell(one.bound),
            Cell("FAILS" if name in found.faults else "passes"),
            Cell(found.words(name)),
        ]
        for name, one in found.table.items()
    }
    caption = f"The figures of the {NAMES[found.kind]}."
    return Table(caption, ("value", "threshold", "result", "meaning"), rows)
