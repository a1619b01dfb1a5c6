# %% [markdown]
# # A dataset
#
# A drive is recorded once, as a small file without pictures. Sensor data are made from it later, under any
# weather and traffic. This page replays one second of the drive that comes with the package.

# %%
from pathlib import Path

from recorder import DEMO_DRIVE, ReplayConfig, open_episode, replay, summarise

drive = summarise(open_episode(DEMO_DRIVE))
print(f"{drive.map}: {drive.duration_s:.0f} s, {drive.driven_m:.0f} m, {drive.vehicles} vehicles")

# %% [markdown]
# Two weathers make two sequences. Both have the same motion, the same calibration and the same ground truth.

# %%
result = replay(
    ReplayConfig(
        episode=DEMO_DRIVE,
        out=Path("data"),
        weathers=("ClearNoon", "RainyNight"),
        rig="flu",
        formats=("rosbag1",),
        topics="slam",
        start_s=4.0,
        duration_s=1.0,
        workers=1,
    )
)
for name, count in result.samples.items():
    print(f"{name:<16} {count:>4} samples")

# %% [markdown]
# The folder is a dataset: checksums, calibration for other programs, and the true trajectory of each sensor.

# %%
for path in sorted(Path("data").rglob("*")):
    if path.is_file():
        print(f"{path.stat().st_size:>10}  {path}")

# %% [markdown]
# `verify` reads all of it back: checksums, numbers of samples, stamps, and whether calibration fits the data.

# %%
from recorder import verify

print("findings:", verify(Path("data")).findings)

# %%
import shutil

for folder in result.sequences:
    shutil.copy(folder / "preview.png", f"{folder.name}.png")

# %% [markdown]
# Each sequence has a film to look at, and a picture of it:
#
# ![ClearNoon](ClearNoon_dynamic.png)
#
# ![RainyNight](RainyNight_dynamic.png)
