"""Listeners to a driving world: the writer of its episode, and the observer of traffic rules.

Violations of traffic rules by the ego: red lights, off the road, wrong way, too fast, off the route.
"""

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_TICKS, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.physics.contacts import Contact
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.traffic.signals import SignalState
from recorder.episode.ego_messages import EgoRow
from recorder.episode.writer import EpisodeWriter

FIRST_DRIVEN_TICK = 2
"""Ticks 0 and 1 are part of `DrivingWorld.reset`."""
_APART_S, _APART_M = 1.0, 1.0
"""A car that is free for so long [s], and so far from the last touch [m], has left what it touched."""


def ego_row(state: EgoState, controls: Controls, raw: Controls | None) -> EgoRow:
    """What an episode keeps of the ego after a tick."""
    return EgoRow(
        position_m=state.position_m,
        quat_xyzw=state.quat_xyzw,
        velocity_world_mps=state.velocity_world_mps,
        omega_body_radps=state.omega_body_radps,
        controls=controls,
        raw=raw,
        road_wheel_rad=state.road_wheel_rad,
        speed_mps=state.speed_mps,
        wheel_spin_radps=state.wheel_spin_radps,
    )


class EpisodeListener:
    """A `DriveListener` that records; one for each attempt at a drive.

    Args:
        begin: Makes the writer once the actors are known.
    """

    def __init__(self, begin: Callable[[ActorCatalog], EpisodeWriter]) -> None:
        self._begin = begin
        self._touching: set[str] = set()
        self._seen: set[str] = set()
        self._collisions: dict[str, tuple[int, NDArray[np.float64]]] = {}
        self.raw: Controls | None = None
        """The device's axes before shaping, for the coming tick."""
        self.counts: Counter[str] = Counter()
        """How often each kind of event has happened; touches of one collision count once."""

    @property
    def is_touching(self) -> bool:
        """Whether the ego touches something now."""
        return bool(self._seen or self._touching)

    def on_start(self, catalog: ActorCatalog) -> None:
        """Open the episode."""
        self.writer = self._begin(catalog)

    def on_tick(self, tick: int, state: EgoState, controls: Controls) -> None:
        """Record the ego."""
        self._touching, self._seen = self._seen, set()
        self._position_m = state.position_m
        for what in [what for what, last in self._collisions.items() if self._has_left(tick, *last)]:
            del self._collisions[what]
        self.writer.ego(tick, ego_row(state, controls, self.raw))

    def on_step(self, step: int, frame: ActorFrame, signals: NDArray[np.uint8]) -> None:
        """Record the others and the lights."""
        self.writer.step(step, frame, signals)

    def on_contact(self, tick: int, contact: Contact) -> None:
        """Record where a touch begins; one of a collision that still lasts is marked by ``again``."""
        what = str(contact.actor_id) if contact.actor_id is not None else "static"
        self._seen.add(what)
        if what not in self._touching:
            data = {"with": what, "impulse_ns": contact.impulse_ns}
            if what in self._collisions:
                self.writer.event(tick, "collision", {**data, "again": True})
            else:
                self.event(tick, "collision", data)
        self._collisions[what] = tick, self._position_m

    def _has_left(self, tick: int, last_tick: int, last_m: NDArray[np.float64]) -> bool:
        far = math.dist(self._position_m, last_m) > _APART_M
        return far and (tick - last_tick) * TICK_S > _APART_S

    def event(self, tick: int, kind: str, data: dict[str, object] | None = None) -> None:
        """Record and count something that happened."""
        self.counts[kind] += 1
        self.writer.event(tick, kind, data)


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
