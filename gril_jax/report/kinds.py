"""Tells runs with the page of one reward and one policy from those with something else.

    table1                             a page of its own, see `gril_jax.experiments.table1.columns`
    table2, soundness, ablate, sweep   a table and a figure, and no page

Neither JAX nor MuJoCo is imported here.
"""

import json
from pathlib import Path

from gril_jax.errors import RunError

_SINGLE = (None, "train", "pretrain")
_INSTEAD = {"table1": "its page is report.html, its table table1.md"} | {
    name: f"it has no page, but the table {name}.md and the figure {name}.png"
    for name in ("table2", "soundness", "ablate", "sweep")
}


def made_by(folder: Path) -> str | None:
    """The experiment that made a run's folder, such as `train`; None if it is not recorded."""
    file = folder / "phases.json"
    try:
        experiment = json.loads(file.read_text(encoding="utf-8"))["experiment"]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise RunError(f"{file} is damaged, so it is not known what made the run") from None
    if experiment is not None and not isinstance(experiment, str):
        raise RunError(f"{file}: experiment must be a name, not {experiment!r:.40}")
    return experiment


def require_single(folder: Path) -> None:
    """Raises `RunError` if the run belongs to a table, and so has no single reward and policy; the
    sentence says where its results lie."""
    experiment = made_by(folder)
    if experiment not in _SINGLE:
        instead = _INSTEAD.get(experiment, "its results lie there in files of their own")
        raise RunError(f"{folder} holds a run of gril {experiment}, not of one policy: {instead}")
