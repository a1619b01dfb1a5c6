"""Score an estimate: how far is the path of raw GNSS fixes from the truth?"""

import sys
from pathlib import Path

import numpy as np

from carlaloc_env import GnssFix, SensorStage, rig_by_name, weather_by_name
from recorder import Alignment, Episode, EvaluationResult, Metric, Trajectory, evaluate, town_of


def main(drive: Path, seed: int = 0) -> EvaluationResult:
    """Compare the fixes of a recorded drive with the true positions of the antenna."""
    episode = Episode.load(drive)
    town, timeline = town_of(episode), episode.timeline()
    stage = SensorStage(town, seed=seed, weather=weather_by_name("ClearNoon"))
    state_rig = rig_by_name("state")
    rig = state_rig.build(stage)
    fixes = [s for s in rig.measure(timeline, -1, timeline.end_ns) if isinstance(s, GnssFix)]

    stamps = np.array([fix.stamp_ns for fix in fixes])
    geodetic = np.array([(fix.latitude_deg, fix.longitude_deg, fix.altitude_m) for fix in fixes])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (len(fixes), 1))
    estimate = Trajectory(
        stamp_ns=stamps, position_m=town.roads.geo.geodetic_to_enu(geodetic), quat_xyzw=level, name="raw GNSS"
    )
    motion = timeline.ego_motion(stamps).at_mount(state_rig.frames["gnss"])
    truth = Trajectory(
        stamp_ns=stamps, position_m=motion.position_m, quat_xyzw=motion.quat_xyzw, name="antenna"
    )

    positions_only = (Metric.APE_TRANSLATION, Metric.RPE_PAPER, Metric.RPE_POINT_DISTANCE)
    result = evaluate(truth, estimate, alignment=Alignment.NONE, metrics=positions_only)
    for metric, statistics in result.statistics.items():
        print(f"{metric.value:<72} rmse {statistics.rmse:8.3f} {metric.unit}")
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1]))
