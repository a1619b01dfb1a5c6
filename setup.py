"""Which folders become packages: all below carlaloc_env/ and recorder/, and maps/ as `carlaloc_env.maps`.

The rest stands in pyproject.toml, which can find packages or rename a folder, but not both.
"""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["carlaloc_env*", "recorder*"]),
        *(f"carlaloc_env.{name}" for name in find_packages(include=["maps*"])),
    ],
    package_dir={"carlaloc_env.maps": "maps"},
)
