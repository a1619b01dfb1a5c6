"""Empty matplotlib figures, the colours of lines in plots, and PNG files."""

from pathlib import Path
from typing import Any

from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from carlaloc_env.core.files.atomic_files import atomic_write

COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
    "#56B4E9", "#8C564B", "#7F7F7F", "#B8A000", "#444444",
)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind people can tell apart, and some more."""


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty figure of matplotlib [inches].

    Raises:
        MissingDependencyError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            'plots need matplotlib; install it with: pip install "carlaloc[report]"'
        ) from error
    # Without pyplot, which keeps figures in a global list and may look for a display.
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: Path) -> Path:
    """Write a figure as a PNG, whole or not at all.

    Raises:
        EvaluationError: it cannot be written.
    """
    with atomic_write(path, EvaluationError) as part:
        figure.savefig(part, format="png", dpi=110)
    return path
