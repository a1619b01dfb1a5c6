# %% [markdown]
# # SLAM
#
# LiDAR odometry on twelve seconds of a drive, without movers and among them. The LiDAR alone needs no pictures.

# %%
from pathlib import Path

from recorder import ReplayConfig, replay
from recorder.demo.story import DRIVE

result = replay(
    ReplayConfig(
        episode=DRIVE,
        out=Path("data"),
        traffic=("static", "dynamic"),
        rig="lidar",
        formats=("rosbag1",),
        duration_s=12.0,
        preview=False,
        workers=1,
    )
)
print([path.name for path in result.sequences])

# %% [markdown]
# An odometry of small_gicp (extra `slam`) runs over each bag. Its trajectory is a text file in TUM's form.

# %%
from recorder import Metric, evaluate, plot_trajectories, read_tum, run_odometry

truth = read_tum(result.ground_truth / "lidar.tum")
scores = []
for folder in result.sequences:
    (bag,) = folder.glob("*.bag")
    estimate = run_odometry("gicp", bag, Path(f"{folder.name}.tum"))
    scores.append(evaluate(truth, read_tum(Path(f"{folder.name}.tum"))))
    ape = scores[-1].statistics[Metric.APE_TRANSLATION]
    print(f"{folder.name:<20} APE {ape.rmse:.3f} m, largest error {ape.max:.3f} m")

# %%
path = plot_trajectories(scores, "trajectories.png", title="Town10")

# %% [markdown]
# ![Estimates over the truth](trajectories.png)
#
# [Your own system](../your-system.md) reads the same sequences: by a Python function, a program, or a ROS node.
