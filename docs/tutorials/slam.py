# %% [markdown]
# # SLAM
#
# LiDAR odometry on eighteen seconds of a drive, without movers and among them.

# %%
from dataclasses import replace
from pathlib import Path

from recorder import DEMO_DRIVE, ReplayConfig, replay

result = replay(
    ReplayConfig(
        episode=DEMO_DRIVE,
        out=Path("slam"),
        traffic=("static", "dynamic"),
        rig="lidar",
        formats=("rosbag1",),
        duration_s=18.0,
        preview=False,
        workers=1,
    )
)
print([path.name for path in result.sequences])

# %% [markdown]
# The odometry of small_gicp (extra `slam`) runs over each bag.

# %%
from recorder import Metric, evaluate, plot_trajectories, read_tum, run_odometry

truth = read_tum(result.ground_truth / "lidar.tum")
scores = []
for folder in result.sequences:
    (bag,) = folder.glob("*.bag")
    estimate = replace(run_odometry(bag, "gicp"), name=folder.name)
    scores.append(evaluate(truth, estimate))
    ape = scores[-1].statistics[Metric.APE_TRANSLATION]
    print(f"{folder.name:<20} APE {ape.rmse:.3f} m, largest error {ape.max:.3f} m")

# %%
path = plot_trajectories(scores, "trajectories.png", title="Town03")

# %% [markdown]
# ![Estimates over the truth](trajectories.png)
#
# [Your own system](../your-system.md) reads them too, as a Python function, a program or a ROS node.
