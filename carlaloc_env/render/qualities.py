"""Names of render qualities; imports little, so that a wrong one is reported before anything is drawn."""

from carlaloc_env.core.errors import ConfigError, unknown_name

QUALITIES = ("low", "medium", "high")
"""One sample per pixel; the same with a lens blur of 0.5 px; 2×2 samples resolved before shading."""


def check_quality(quality: str) -> str:
    """The quality, if there is one of that name.

    Raises:
        ConfigError: it is none of `QUALITIES`.
    """
    if quality not in QUALITIES:
        raise ConfigError(unknown_name("render quality", quality, QUALITIES))
    return quality
