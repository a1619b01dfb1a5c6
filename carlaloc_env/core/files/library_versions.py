"""Versions of libraries by their usual names, whichever distribution brought them."""

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTIONS = {
    "pybullet": ("pybullet", "pybullet-arm64"),
    "open3d": ("open3d-cpu", "open3d"),
    "pygame": ("pygame-ce", "pygame"),
}
"""Distributions of libraries that several bring: forks of PyBullet and pygame, Open3D without CUDA."""


def installed_distributions(library: str) -> dict[str, str]:
    """Versions of the distributions that brought a library; several overwrite each other's files."""
    versions = {}
    for name in DISTRIBUTIONS.get(library, (library,)):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions


def library_version(library: str) -> str:
    """Version of a library.

    Raises:
        PackageNotFoundError: It is not installed.
    """
    versions = installed_distributions(library)
    if not versions:
        raise PackageNotFoundError(library)
    return next(iter(versions.values()))
