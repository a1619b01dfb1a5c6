"""The properties in which car models differ."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.assets.vehicles.body import BodyShape, Points
from carlaloc_env.scene.materials import Tag


@dataclass(frozen=True, slots=True, kw_only=True)
class CarSpec:
    """A car: its shell and the places of lamps, plates and trim; shares are of the half width."""

    shape: BodyShape
    tag: Tag = Tag.CAR
    tyre_width_m: float = 0.21
    spokes: int = 5
    head: Points = ((0.56, 0.62), (0.93, 0.60), (0.955, 0.70), (0.55, 0.69))
    """Outline of the left headlamp, (share, z)."""
    grille: tuple[float, float, float, float] = (0.50, 0.54, 0.52, 0.66)
    """Grille: half width below and above (shares), lower and upper edge z."""
    bars: int = 3
    """Bars across the grille."""
    chrome: bool = False
    """Whether grille and windows have bright frames."""
    intake: tuple[float, float, float, float] = (0.66, 0.58, 0.24, 0.38)
    """Opening in the bumper, as `grille`."""
    tail: Points = ((0.55, 0.76), (0.95, 0.74), (0.95, 0.90), (0.55, 0.88))
    """Outline of the left tail lamp, (share, z)."""
    tail_across: bool = False
    """Whether a strip joins the tail lamps."""
    plate_z: tuple[float, float] = (0.44, 0.80)
    """Height of front and rear number plate [m]."""
    doors: tuple[float, ...] = ()
    """Door gaps, distances from the nose [m]."""
    slide: bool = False
    """Whether a sliding door's rail runs along the flank."""
    barn_doors: bool = False
    """Whether the tail opens in two doors."""
    rear_window: tuple[float, float] | None = None
    """Upright rear window, heights from and to [m]."""
    rails: bool = False
    """Whether bars run along the roof."""
    exhausts: int = 1
    valance_m: float = 0.12
    """Height of the dark lower edge of nose and tail [m]."""
