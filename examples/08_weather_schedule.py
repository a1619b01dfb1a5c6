"""Your own weather schedule: in a replay, a clear noon turns to fog within seconds."""

import sys
from pathlib import Path

import cv2
import numpy as np

from recorder import ReplayConfig, replay

SCHEDULE = """
- at_s: 0
  weather: ClearNoon
- at_s: {middle_s}
  weather: ClearNoon
- at_s: {end_s}
  weather: {{cloudiness: 100, fog_density: 90, fog_distance: 5, sun_altitude_angle: 20}}
"""


def main(drive: Path, out: Path, seconds: float = 2.0, rig: str = "minimal") -> tuple[float, float]:
    """Replay under the schedule; mean steps from pixel to pixel of the first and the last picture."""
    out.mkdir(parents=True, exist_ok=True)
    schedule = out / "fog_rolls_in.yaml"
    schedule.write_text(SCHEDULE.format(middle_s=seconds / 2, end_s=seconds))
    config = ReplayConfig(
        episode=drive, out=out / "data", weathers=(str(schedule),), rig=rig, formats=("euroc",),
        duration_s=seconds + 1.0, workers=1, quality="low", preview=False,
    )  # fmt: skip
    (sequence,) = replay(config).sequences
    pictures = sorted((sequence / "mav0/cam0/data").glob("*.png"))
    grey = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (pictures[0], pictures[-1])]
    # The upper half alone, since fog does not hide the bonnet below.
    halves = [picture[: len(picture) // 2].astype(float) for picture in grey if picture is not None]
    first, last = (float(np.abs(np.diff(half, axis=1)).mean()) for half in halves)
    print(f"{sequence.name}: {len(pictures)} pictures, detail {first:.1f} at noon, {last:.1f} in fog")
    return first, last


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
