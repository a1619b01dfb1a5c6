"""Digest of the code that a result comes from: a module, all that it imports, and versions of libraries.

What is kept on disk (towns, models, textures, machine code) is named after such a digest, so that it is
made anew when any source that went into it changes, and nobody keeps a list of these sources by hand.
"""

import functools
import hashlib
import importlib
import re
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError
from pathlib import Path

from carlaloc_env.core.files.library_versions import library_version

_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n#]*)|import[ \t]+([^\n#]+))", re.MULTILINE
)
"""One import statement of a module."""
_IMPORTED_NAME = re.compile(r"(\w+)(?:[ \t]+as[ \t]+\w+)?")
"""One name of an import, whatever it is called here."""
_VERSIONS = ("__version__", "geos_version_string")
"""Attributes that name a library's version, and that of the GEOS which shapely computes with."""


@functools.cache
def source_digest(module: str) -> str:
    """Digest of a module's source, of all it imports from its own package, and of library versions.

    Imports within functions and for type checkers count too. The package's own `__init__` does not:
    it lends names and computes nothing.

    Args:
        module: Full name of an imported module, such as ``carlaloc_env.town.build``.

    Returns:
        32 hexadecimal digits.
    """
    sources, libraries = imported_by(module)
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(sources):
        digest.update(f"{name} {len(sources[name])}\n".encode())
        digest.update(sources[name])
    for library in sorted(libraries):
        digest.update(f"{library} {_version(library)}\n".encode())
    return digest.hexdigest()


def imported_by(module: str) -> tuple[dict[str, bytes], set[str]]:
    """Sources of a module and of all that it imports from its package, and the libraries these import.

    Returns:
        Content of each source by the module's name, and top-level names of libraries.
    """
    package, _, _ = module.partition(".")
    root = _folder_of(package)
    sources: dict[str, bytes] = {}
    libraries: set[str] = set()
    waiting = [module]
    if module == package and not hasattr(sys.modules[module], "__path__"):
        sources[module], waiting = _read(Path(str(sys.modules[module].__file__)))[0], []
    while waiting:
        name = waiting.pop()
        if name.partition(".")[0] != package:
            libraries.add(name.partition(".")[0])
        elif name not in sources and name != package:
            path = _file_of(root, name)
            if path is not None:
                sources[name], imported = _read(path)
                waiting += imported
                waiting.append(name.rpartition(".")[0])
    return sources, libraries - sys.stdlib_module_names


@functools.cache
def _read(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """Content of a source, and the names that it imports: of modules, and of what these hold."""
    content = path.read_bytes()
    names: list[str] = []
    for source, members, plain in _IMPORT.findall(content.decode()):
        if source:
            names.append(source)
            names += [f"{source}.{member}" for member in _IMPORTED_NAME.findall(members)]
        else:
            names += [part.split()[0] for part in plain.split(",")]
    return content, tuple(names)


@functools.cache
def _file_of(root: Path, module: str) -> Path | None:
    """Source of a module below the folder of its package; None for what is no module but a name in one."""
    path = root.joinpath(*module.split(".")[1:])
    for candidate in (path.with_name(f"{path.name}.py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _folder_of(package: str) -> Path:
    file = sys.modules[package].__file__
    if file is None:
        raise ImportError(f"{package} has no __init__.py")
    return Path(file).parent


@functools.cache
def _version(library: str) -> str:
    if library == "open3d":  # importing it takes half a second, which what casts no rays need not wait for
        with suppress(PackageNotFoundError):
            return library_version(library)
    try:
        module = importlib.import_module(library)
    except ImportError:
        return "missing"
    return " ".join(str(getattr(module, name)) for name in _VERSIONS if hasattr(module, name))
