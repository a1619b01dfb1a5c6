"""Hooks of MkDocs: pages of the root, links to code, the reference, tutorials as pages and notebooks."""

import ast
import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

from carlaloc_env import TOWNS
from tutorials import notebook_of, run_tutorial

ROOT = Path(__file__).resolve().parents[2]
FROM_ROOT = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
"""Pages that lie outside docs/, and their names in the site."""
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)#\s]+)(#[^)]*)?\)")


def on_config(config: Any) -> Any:
    """Name the repository in the menu, where its address is known."""
    if repository := config.extra["repository"]:
        config.nav[-1]["Project"].append({"Source": repository})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made."""
    for source, page in FROM_ROOT.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    for package in ("carlaloc_env", "recorder"):
        files.append(File.generated(config, f"reference/{package}.md", content=reference(package)))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    for script in sorted((ROOT / "docs" / "tutorials").glob("*.py")):
        for name, content in ((f"{script.stem}.ipynb", notebook_of(script)), *run_tutorial(script)):
            files.append(File.generated(config, f"tutorials/{name}", content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Lead links to pages of the site, or to the repository where they name code and its address is known."""
    here = {made: source for source, made in FROM_ROOT.items()}.get(page.file.src_uri)
    source = ROOT / here if here else ROOT / "docs" / page.file.src_uri

    def lead(match: re.Match[str]) -> str:
        text, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        path = Path(os.path.normpath(source.parent / target))
        place = os.path.relpath(path, ROOT)
        name = FROM_ROOT.get(place, place.removeprefix("docs/"))
        file = files.src_uris.get(name)
        if file is not None and file.inclusion.is_included():
            return f"[{text}]({os.path.relpath(name, Path(page.file.src_uri).parent)}{anchor})"
        if not (repository := config.extra["repository"]):
            return text
        kind = "tree" if path.is_dir() else "blob"
        return f"[{text}]({repository}/{kind}/main/{place}{anchor})"

    return _LINK.sub(lead, markdown)


def reference(package: str) -> str:
    """A page of all public names of a package, in the order of its stub."""
    tree = ast.parse((ROOT / package / "__init__.pyi").read_text(encoding="utf-8"))
    lines = [f"# {package}\n"]
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            lines += [f"::: {node.module}.{alias.name}\n" for alias in node.names]
    return "\n".join(lines)


CITIES = ("Berlin", "Krems")
"""Places from OpenStreetMap that the gallery shows."""


def gallery() -> str:
    """A page of all towns, and of two cities."""
    towns = "\n".join(f"## {town}\n\n![{town}](gallery/{town}.jpg)\n" for town in (*TOWNS, *CITIES))
    credit = "Data of the cities: © OpenStreetMap contributors, ODbL 1.0."
    weathers = "## Three weathers\n\n![All towns](gallery/weathers.jpg)\n"
    winter = "## Winter\n\n![Three towns in snow](gallery/winter.jpg)\n"
    return f"# Gallery\n\n{weathers}\n{winter}\n{towns}\n{credit}\n"
