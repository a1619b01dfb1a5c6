"""Draw one second of the directions of Livox's LiDARs, docs/pictures/livox.png: `make_lidar_picture.py`."""

from pathlib import Path

import numpy as np

from carlaloc_env.sensors.lidar.sweep_rays import RayPattern
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.report.canvas import COLOURS, new_figure, save_figure

PICTURE = Path(__file__).parents[1] / "pictures" / "livox.png"
TITLES = {"mid360": "Mid-360: 200 000 points", "avia": "Avia: 240 000 points"}


def main(path: Path = PICTURE) -> Path:
    """Azimuth and elevation of every ray; the first 0.1 s, which is one message, in another colour."""
    figure = new_figure(12.0, 4.8)
    figure.suptitle("Directions in 1 s; those of the first 0.1 s, a message, are orange")
    axes = figure.subplots(1, 2, width_ratios=(2.4, 1.0))
    for panel, (name, title) in zip(axes, TITLES.items(), strict=True):
        config = LidarConfig(**LidarConfig.preset_values(name))
        rays = RayPattern(config)
        for k in range(9, -1, -1):
            x, y, z = rays.sweep(k * config.sweep_ns, 0).directions.T
            azimuth, elevation = np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))
            colour, size = (COLOURS[1], 1.6) if k == 0 else (COLOURS[0], 0.25)
            panel.plot(azimuth, elevation, ",", color=colour, ms=size, alpha=1.0 if k == 0 else 0.35)
        panel.set(title=title, xlabel="azimuth, left positive [deg]", aspect="equal")
        panel.invert_xaxis()
    axes[0].set_ylabel("elevation [deg]")
    return save_figure(figure, path)


if __name__ == "__main__":
    main()
