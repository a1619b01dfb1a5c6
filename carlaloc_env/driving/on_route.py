"""A car on its route: where it is on it, and the lights and road users that it sees there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from carlaloc_env.core.clock import STEP_NS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from carlaloc_env.driving.road_ahead import RoadAhead
    from carlaloc_env.map.routing.route import Route
    from carlaloc_env.timeline.actors import ActorFrame
    from carlaloc_env.timeline.timeline import Timeline
    from carlaloc_env.town.town import Town
    from carlaloc_env.traffic.stop_lines import StopLines


class OnRoute(ABC):
    """Present place of a car; living, recorded and believed cars move it, each in its way."""

    town: Town
    """Where it drives."""
    route: Route
    """Where it shall go."""
    timeline: Timeline
    """Itself, all others and the lights over time."""
    _road: RoadAhead

    @property
    @abstractmethod
    def now_ns(self) -> int:
        """Present time [ns]: everything up to it is known for certain."""

    @property
    def route_s_m(self) -> float:
        """Distance along its route [m]; keeps growing on a closed route."""
        return self._road.progress_m

    @property
    def route_offset_m(self) -> float:
        """Offset to the left of its route [m]."""
        return self._road.offset_m

    @property
    def stop_lines(self) -> StopLines:
        """Stop lines of the route at which lights must be obeyed."""
        return self._road.stop_lines

    def signals(self) -> NDArray[np.uint8]:
        """State of every signal head of the town now (`SignalState`), shape (S,)."""
        return self.timeline.signals_at(self.now_ns)

    def actors(self) -> ActorFrame:
        """All other road users at the last whole step."""
        return self.timeline.actors_at(self.now_ns // STEP_NS * STEP_NS)
