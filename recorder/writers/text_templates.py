"""Text files from templates, with numbers that both PyYAML and OpenCV's FileStorage read as what they are."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined


def filled(template: str, *, package: str = "recorder.writers", **values: Any) -> str:
    """Text of a template with its values filled in.

    Args:
        template: Name of the file that is written, its folder included.
        package: Package whose folder ``templates`` holds the template.
        values: Values by the names that the template uses.
    """
    return _environment(package).get_template(f"{template}.jinja").render(values)


@cache
def _environment(package: str) -> Environment:
    environment = Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"real": real, "rows": rows, "nested": nested}
    return environment


def real(value: float) -> str:
    """A real number, always with a point: OpenCV takes 640 for an integer and PyYAML 2e-05 for a text."""
    text = repr(round(float(value), 15) + 0.0)
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")
    return text


def rows(matrix: Any) -> str:
    """All numbers of a matrix in one bracket, a line per row."""
    return "[" + ",\n".join(_row(row) for row in np.asarray(matrix, np.float64)) + "]"


def nested(matrix: Any) -> str:
    """A matrix as a list of rows, one item per line."""
    return "\n".join(f"- [{_row(row)}]" for row in np.asarray(matrix))


def _row(values: Any) -> str:
    return ", ".join(real(value) for value in values)
