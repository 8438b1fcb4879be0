"""Style of every figure: colours, fonts, line widths, and rendering to pixels.

Figures are drawn with Agg: pyplot's global list of figures, the user's matplotlibrc and the display
play no part. Text is never read as mathematics, so a name from a file may hold any character.
"""

import functools
import io
import warnings
from collections.abc import Callable
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# Okabe and Ito's colours, which the common kinds of colour blindness can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7")
GREY, INK = "#6E6E6E", "#222222"
WIDTH = 9.0  # inches: a figure by itself
HALF = 4.6  # inches: a figure beside another on a page; on a phone 10 points are still readable
_DPI = 160

_STYLE = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#888888",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "figure.dpi": _DPI,
    "figure.facecolor": "white",
    "font.size": 10,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.8,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "savefig.dpi": "figure",
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": INK,
    "xtick.labelsize": 9,
    "ytick.color": INK,
    "ytick.labelsize": 9,
}


def styled(draw: Callable) -> Callable:
    """Context in which functions draw in this style; the caller's style is restored afterwards."""

    @functools.wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Any:
        with matplotlib.rc_context(), warnings.catch_warnings():
            # A name in a script that the font lacks shows as boxes; the page has it in full.
            warnings.filterwarnings("ignore", message="Glyph .* missing")
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(_STYLE)
            return draw(*args, **kwargs)

    return drawn


@styled
def png(figure: Figure) -> bytes:
    """A figure as a PNG file's contents: the same bytes for the same figure."""
    contents = io.BytesIO()
    figure.savefig(contents, format="png", metadata={"Software": None})
    return contents.getvalue()


@styled
def pixels(figure: Figure) -> UInt8[np.ndarray, "H W 3"]:
    """A figure as an RGB picture."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def shortened(name: str, limit: int = 48) -> str:
    """A name on one line, without unprintable characters, cut to `limit` characters."""
    name = " ".join("".join(c if c.isprintable() else " " for c in name).split())
    return name if len(name) <= limit else f"{name[: limit - 1]}…"
