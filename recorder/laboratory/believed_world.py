"""The world as a driver with a map and an estimated pose believes it."""

from dataclasses import replace

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import apply, invert, transform, wrap_angle
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.driving.on_route import OnRoute
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.actors import ActorFrame
from recorder.laboratory.pose_source import PoseSource


class BelievedWorld(OnRoute):
    """A `TaskWorld` whose car is where a source of poses believes it.

    Lanes, route, speed limits and stop lines come from the map, by the believed pose. Others are seen from
    the car, so they are believed as wrong as the car itself. Speed and body rates are the car's own.

    Args:
        world: The true world, which has just been reset.
        source: Where the pose comes from.
    """

    def __init__(self, world: DrivingWorld, source: PoseSource) -> None:
        self._world, self._source = world, source
        self.town, self.route, self.timeline = world.town, world.route, world.timeline
        self._road = RoadAhead(world.town.network, world.route)
        self._road.start(self.state.position_m)

    def follow(self) -> None:
        """Update the believed pose after a step."""
        self._road.follow(self.state.position_m)

    @property
    def now_ns(self) -> int:
        """Present time [ns]."""
        return self._world.now_ns

    @property
    def T_true(self) -> Array:
        """True pose of `base_link`, (4, 4)."""
        state = self._world.state
        return transform(state.position_m, state.quat_xyzw)

    @property
    def state(self) -> EgoState:
        """Believed state of the car."""
        state, T_true = self._world.state, self.T_true
        T = self._source.believed(T_true)
        return replace(state, position_m=T[:3, 3].copy(), heading_rad=state.heading_rad + _turn(T, T_true))

    def actors(self) -> ActorFrame:
        """Other road users at their believed places."""
        actors, T_true = super().actors(), self.T_true
        T = self._source.believed(T_true)
        if T is T_true or not len(actors):
            return actors
        return replace(
            actors,
            position_m=apply(T @ invert(T_true), actors.position_m).astype(np.float32),
            heading_rad=(actors.heading_rad + _turn(T, T_true)).astype(np.float32),
        )

    def driver_view(self) -> DriverView:
        """View of a driver at the believed pose."""
        true = self._world.driver_view()
        return self._road.view(
            tick=true.tick,
            state=self.state,
            acceleration_mps2=true.acceleration_mps2,
            actors=self.actors(),
            catalog=self.timeline.catalog,
            signals=self.signals(),
        )


def _turn(T: Array, T_true: Array) -> float:
    """Believed less true heading [rad]."""
    yaw, yaw_true = (np.arctan2(pose[1, 0], pose[0, 0]) for pose in (T, T_true))
    return float(wrap_angle(yaw - yaw_true))
