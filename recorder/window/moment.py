"""One moment of a drive: all that a picture of it needs, small enough for another process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.placing import ego_lights, place_actors, place_ego, place_lights, place_signals
from carlaloc_env.driving import DrivingWorld
from carlaloc_env.scene import Instances, concatenate_instances
from carlaloc_env.stage import SensorStage
from carlaloc_env.timeline import ActorCatalog, ActorFrame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """State of the world at one time."""

    stamp_ns: int
    """Time since the drive began [ns]."""
    T_world_base: NDArray[np.float64]
    """Pose of the ego's `base_link`, shape (4, 4)."""
    lights: int
    """Bits of the ego's lit lights."""
    catalog: ActorCatalog
    """Who else takes part."""
    actors: ActorFrame
    """Their state."""
    signals: NDArray[np.uint8]
    """State of every traffic light, shape (S,)."""

    @classmethod
    def of(cls, world: DrivingWorld) -> Moment:
        """The present of a world."""
        now, timeline = world.now_ns, world.timeline
        return cls(
            stamp_ns=now,
            T_world_base=timeline.ego_motion([now]).T_world_frame[0],
            lights=ego_lights(timeline.car, now),
            catalog=timeline.catalog,
            actors=timeline.actors_at(now),
            signals=timeline.signals_at(now),
        )

    def instances(self, stage: SensorStage) -> Instances:
        """Everything movable, as models of the stage's library."""
        library, eye_m = stage.library, self.T_world_base[:3, 3]
        return concatenate_instances(
            [
                place_ego(self.T_world_base, library, self.lights),
                place_actors(self.catalog, self.actors, library, eye_m=eye_m),
                place_lights(self.catalog, self.actors, library, self.stamp_ns, eye_m=eye_m),
                place_signals(stage.lenses, self.signals, library),
            ]
        )
