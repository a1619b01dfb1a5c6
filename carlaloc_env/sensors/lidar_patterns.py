"""Optics of LiDARs whose beams do not go round in columns: rotating wedges, and the Mid-360's fan.

Livox publishes no formula. The figures of `lidar_presets` were fitted to the tables of directions that Livox
gives away for simulators (`livox_laser_simulation`, MIT licence); the names here are those of the fits.
"""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.core.errors import ConfigError

FACES = ("entry", "exit")
"""Faces of a wedge, of which one is inclined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WedgePattern:
    """Risley prisms: wedges that turn one behind the other about the x axis bend each beam by Snell's law.

    A beam enters along the x axis, raised by its own elevation. The seed draws how long the wedges have
    turned when a drive begins: their rates may be locked to each other, and their phases with them.
    """

    wedge_deg: tuple[float, ...]
    """Angle between the faces of each wedge, in the order of the beam [deg]."""
    turns_hz: tuple[float, ...]
    """Turns of each wedge a second, from y to z positive [Hz]."""
    phase_deg: tuple[float, ...]
    """Direction to which the inclined face of each wedge looks in the beginning [deg]."""
    inclined: tuple[str, ...]
    """Inclined face of each wedge, ``entry`` or ``exit``."""
    field_deg: tuple[float, float]
    """Lowest and highest elevation of the field of view [deg]."""
    width_deg: float
    """Width of the field of view [deg]."""
    index: float = 1.51
    """Refractive index of the glass [1]."""

    def __post_init__(self) -> None:
        if len({len(v) for v in (self.wedge_deg, self.turns_hz, self.phase_deg, self.inclined)}) > 1:
            raise ConfigError("pattern: each list needs an entry for each wedge")
        if set(self.inclined) - set(FACES) or self.index < 1.0:
            raise ConfigError("pattern: inclined is 'entry' or 'exit' for each wedge, index at least 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class FanPattern:
    """A fan of lines that a mirror turns and nods: Fourier series of the turn θ and the nod Δ.

    Elevation e = e₀ + Σ elevation_deg[k]·cos kΔ and azimuth a = −θ + Σ azimuth_deg[k]·sin kΔ are those of the
    fan's middle. A line lies s·Σ tall_deg[j]·cos(θ − kΔ) above it, with k = j − 3. It lies
    s·Σ wide_deg[j]·sin(θ − kΔ)/cos e to the left. The share s is the elevation of the line's beam over the
    largest of all. The seed draws the phases of turn and nod.
    """

    turns_hz: float
    """Turns a second, clockwise seen from above [Hz]."""
    nods_hz: float
    """Nods up and down a second [Hz]."""
    elevation_deg: tuple[float, ...]
    """Cosine series of the elevation of the fan's middle, the constant first [deg]."""
    azimuth_deg: tuple[float, ...]
    """Sine series of the azimuth of the fan's middle, the first harmonic first [deg]."""
    tall_deg: tuple[float, ...]
    """Heights of the fan's edge, 7 of them [deg]."""
    wide_deg: tuple[float, ...]
    """Widths of the fan's edge, 7 of them [deg]."""
    field_deg: tuple[float, float]
    """Lowest and highest elevation of the field of view [deg]."""
    width_deg: float = 360.0
    """Width of the field of view [deg]."""

    def __post_init__(self) -> None:
        if len(self.tall_deg) != 7 or len(self.wide_deg) != 7 or not self.elevation_deg:
            raise ConfigError("pattern: elevation_deg needs a figure, tall_deg and wide_deg 7 each")
