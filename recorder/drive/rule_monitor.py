"""Watches the ego for violations of rules: red lights, off the road, wrong way, too fast, off the route."""

import math

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.signals import SignalState

SPEEDING_OVER_MPS = 10.0 / 3.6
"""How much above the limit counts as speeding [m/s]."""
OFF_ROUTE_M = 8.0
"""Distance from the route that counts as having left it [m]."""
_OFF_ROAD_M = 0.3
_WRONG_WAY_RAD = 2.2
_LASTS_S = {"speeding": 2.0, "wrong_way": 1.0, "off_road": 0.2, "off_route": 0.5}
_JUNCTION_SLACK_M = 3.0
_CROSSED_M = 1.0


class RuleMonitor:
    """Watches a drive at 20 Hz for violations that begin.

    Args:
        network: Lanes of the town.
    """

    def __init__(self, network: LaneNetwork) -> None:
        self._network = network
        self._line_m: float | None = None
        self._lasted_s = dict.fromkeys(_LASTS_S, 0.0)
        self.present: tuple[str, ...] = ()
        """Violations that last now."""

    def update(self, view: DriverView) -> list[str]:
        """Violations that begin at this step."""
        now = {
            "speeding": view.speed_mps > view.speed_limit_mps + SPEEDING_OVER_MPS,
            "off_route": abs(view.offset_m) > OFF_ROUTE_M,
        }
        now["off_road"], now["wrong_way"] = self._lane_keeping(view)
        began = ["red_light"] if self._ran_red(view) else []
        present = []
        for kind, limit_s in _LASTS_S.items():
            before = self._lasted_s[kind]
            lasted = before + STEP_TICKS * TICK_S if now[kind] else 0.0
            self._lasted_s[kind] = lasted
            if lasted >= limit_s:
                present.append(kind)
                if before < limit_s:
                    began.append(kind)
        self.present = (*(["red_light"] if "red_light" in began else []), *present)
        return began

    def _ran_red(self, view: DriverView) -> bool:
        """Whether the front bumper has just crossed a stop line while its light was red."""
        before, self._line_m = self._line_m, view.stop_line_distance_m
        if before is None or self._line_m is None or view.signal_state != SignalState.RED:
            return False
        return before >= 0.0 > self._line_m > before - _CROSSED_M - view.speed_mps and view.speed_mps > 0.3

    def _lane_keeping(self, view: DriverView) -> tuple[bool, bool]:
        """Whether the car's middle is beside every lane, and whether it faces its lane's traffic."""
        middle = view.position_m.copy()
        north, east = sin_cos(view.heading_rad)
        middle[:2] += 1.4 * east, 1.4 * north
        near = self._network.nearest(middle[None])
        lane, station = int(near.lane[0]), near.station_m[:1]
        width = float(self._network.width_m(near.lane[:1], station)[0])
        in_junction = self._network.lanes[lane].junction_id is not None
        slack = _JUNCTION_SLACK_M if in_junction else _OFF_ROAD_M
        off = float(near.distance_m[0]) > 0.5 * width + slack
        heading = float(self._network.pose(near.lane[:1], station).heading_rad[0])
        turned = abs(math.remainder(view.heading_rad - heading, 2.0 * math.pi))
        wrong = turned > _WRONG_WAY_RAD and view.speed_mps > 2.0 and not in_junction and not off
        return off, wrong
