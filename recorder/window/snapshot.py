"""One moment of a drive: all that an image of it needs, small enough for another process."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.actors.instances import (
    ego_lights,
    is_blink,
    place_actors,
    place_ego,
    place_lights,
    place_signals,
)
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.scene.mesh import Instances, concatenate_instances
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.timeline.timeline import LIGHT_LEFT, LIGHT_RIGHT, ActorCatalog, ActorFrame
from recorder.window.status import DriveStatus

VIEWS = ("seat", "chase", "above")
"""Cameras in the order in which the driver goes through them."""
_INDICATORS = {"left": LIGHT_LEFT, "right": LIGHT_RIGHT}
_UNLIT = (1 << 24) - 1
"""Instance id of an ego with its headlamps off: the renderer gives low beams to the ego's own id."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """State of the world at one time."""

    stamp_ns: int
    """Time since the drive began [ns]."""
    T_world_base: NDArray[np.float64]
    """Pose of the ego's `base_link`, shape (4, 4)."""
    lights: int
    """Bits of the ego's lit lights."""
    headlamps: bool
    """Whether the ego's headlamps are on; they show by night only."""
    catalog: ActorCatalog
    """Who else takes part."""
    actors: ActorFrame
    """Their state."""
    signals: NDArray[np.uint8]
    """State of every traffic light, shape (S,)."""

    @classmethod
    def of(cls, world: DrivingWorld, status: DriveStatus) -> Moment:
        """The present of a world, and what the driver has switched on."""
        now, timeline = world.now_ns, world.timeline
        indicator = _INDICATORS.get(status.indicator, 0) if is_blink(now) else 0
        return cls(
            stamp_ns=now,
            T_world_base=timeline.ego_motion([now]).T_world_frame[0],
            lights=ego_lights(timeline.car, now) | indicator,
            headlamps=status.headlamps,
            catalog=timeline.catalog,
            actors=timeline.actors_at(now),
            signals=timeline.signals_at(now),
        )

    def instances(self, stage: SensorStage) -> Instances:
        """Everything movable, as models of the stage's library."""
        library, eye_m = stage.library, self.T_world_base[:3, 3]
        ego = place_ego(self.T_world_base, library, self.lights)
        if not self.headlamps:
            ego = replace(ego, instance=np.full(len(ego), _UNLIT, np.uint32))
        return concatenate_instances(
            [
                ego,
                place_actors(self.catalog, self.actors, library, eye_m=eye_m),
                place_lights(self.catalog, self.actors, library, self.stamp_ns, eye_m=eye_m),
                place_signals(stage.lenses, self.signals, library),
            ]
        )
