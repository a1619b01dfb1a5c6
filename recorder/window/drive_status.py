"""Status of a drive that a window shows beside the world itself."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from carlaloc_env.core.ego import Controls


@dataclass(slots=True)
class DriveStatus:
    """Figures and messages of a drive for the window."""

    controls: Controls = field(default_factory=Controls)
    """Controls of the last tick."""
    device: str = ""
    """Who drives."""
    view: int = 0
    """Number of the camera."""
    indicator: str = ""
    """``left``, ``right`` or empty."""
    headlamps: bool = False
    """Whether the headlamps are on."""
    paused: bool = False
    """Whether time stands still."""
    help: bool = False
    """Whether the keys are shown."""
    buttons: Mapping[str, int] = field(default_factory=dict)
    """Button of each command on wheel or pad."""
    message: str | None = None
    """Line for the driver."""
    slow: float | None = None
    """World over real time when too slow."""
    size_mb: float = 0.0
    """Size of the recording [MB]."""
    collisions: int = 0
    """Number of collisions."""
    broken: int = 0
    """Number of rules broken."""
    warnings: tuple[str, ...] = ()
    """Names of present violations."""
