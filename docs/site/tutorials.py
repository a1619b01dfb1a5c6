"""Tutorials: scripts of cells (``# %%``) as pages with what they print, and as notebooks."""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import jupytext
import nbformat

INSTALL = """\
# Installs CarlaLoc where it is missing: $CARLALOC_SOURCE is a name, a file or an address that pip takes.
import os
from ctypes.util import find_library
from importlib.util import find_spec

if find_spec("carlaloc_env") is None:
    source = os.environ.get("CARLALOC_SOURCE", "carlaloc")
    package = f"carlaloc[slam,report] @ {source}" if "://" in source else f"{source}[slam,report]"
    %pip install --quiet "{package}"
    if not all(find_library(name) for name in ("EGL", "GL", "usb-1.0", "idn2")):
        libraries = "libegl1 libgl1 libgl1-mesa-dri libusb-1.0-0 libidn2-0"
        !apt-get update -qq && apt-get install -y -qq {libraries}"""
"""First cell of a notebook, with the libraries of `.ci/system-libraries`."""
_PICTURES = re.compile(r"((?:!\[.*?\]\(.+?\)\s*)+)")
_PICTURE = re.compile(r"!\[.*?\]\((.+?)\)")
_LINK_IN_DOCS = re.compile(r"(?<!!)\[([^\]]+)\]\((?!\w+:)[^)]*\)")


def cells_of(script: Path) -> list[Any]:
    """Cells of a script, of types ``code`` and ``markdown``."""
    return list(jupytext.reads(script.read_text(encoding="utf-8"), "py:percent").cells)


def notebook_of(script: Path) -> str:
    """The notebook of a script; it has not been run, and its first cell is `INSTALL`."""
    sources = [("code", INSTALL)]
    for cell in cells_of(script):
        sources += [("code", cell.source)] if cell.cell_type == "code" else _of_text(cell.source)
    made: dict[str, Any] = {"code": nbformat.v4.new_code_cell, "markdown": nbformat.v4.new_markdown_cell}
    # Cells without an id would get a random one.
    cells = [made[kind](source, id=f"cell-{place}") for place, (kind, source) in enumerate(sources)]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return str(nbformat.writes(nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})))


def _of_text(text: str) -> Iterator[tuple[str, str]]:
    """Types and sources of cells: text without links into docs, code that shows its pictures.

    Hosted services do not show files in text.
    """
    for part in filter(None, map(str.strip, _PICTURES.split(text))):
        if pictures := _PICTURE.findall(part):
            shown = ", ".join(f'Image("{name}")' for name in pictures)
            yield "code", f"from IPython.display import Image, display\n\ndisplay({shown})"
        else:
            yield "markdown", _LINK_IN_DOCS.sub(r"\1", part)


def run_tutorial(script: Path) -> Iterator[tuple[str, str | bytes]]:
    """Run a script; its text shows pictures that its code has written.

    Args:
        script: The script; it runs in an empty folder.

    Yields:
        Name and content of the page, then of each picture.
    """
    page, space, before = "", {"__name__": script.stem}, Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for cell in cells_of(script):
            if cell.cell_type == "markdown":
                page += f"{cell.source}\n\n"
                continue
            printed = StringIO()
            with redirect_stdout(printed):
                exec(compile(cell.source, str(script), "exec"), space)
            page += f"```python\n{cell.source}\n```\n\n"
            if printed.getvalue():
                page += f"```text\n{printed.getvalue().rstrip()}\n```\n\n"
        os.chdir(before)
        title, text = page.split("\n\n", 1)
        link = f"[A notebook of this page]({script.stem}.ipynb) installs CarlaLoc where it is missing."
        yield f"{script.stem}.md", f"{title}\n\n{link}\n\n{text}"
        for name in _PICTURE.findall(page):
            yield name, Path(folder, name).read_bytes()
