"""Draw docs/pictures/window.jpg, the driver's window: `python docs/scripts/make_window_picture.py`.

The scripted driver drives in Town03, recorded and shown as any drive is. Of a drive without a fault the
picture is taken at which the car is fast and most others are near.
"""

import os
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from recorder.drive.record import RecordConfig, record
from recorder.episode.actor_messages import actor_states
from recorder.episode.episode import Episode
from recorder.window.opening import Opening

PICTURE = Path(__file__).parents[1] / "pictures" / "window.jpg"
TOWN, SEED, DURATION_S = "Town03", 3, 75.0
NEAR_M, FAST_MPS, STRAIGHT_RAD = 40.0, 6.0, 0.03


def main(out: Path = PICTURE) -> Path:
    """Drive, keep what the window shows each second, and write the best of it."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    with tempfile.TemporaryDirectory() as name, Opening(TOWN) as opening:
        folder = Path(name)

        def keep(driven_s: float, _: float) -> None:
            # Saving takes time, and the window shows the delay.
            path = folder / f"{int(driven_s):04d}.png"
            if not path.exists():
                opening.window.save(path)

        config = RecordConfig(
            map=TOWN, out=folder / "drive.mcap", duration_s=DURATION_S, seed=SEED, window=True
        )
        result = record(config, progress=keep, opening=opening)
        if result.collisions or result.violations:
            sys.exit(f"the drive was not clean ({result.violations}, {result.collisions} collisions)")
        shown = cv2.imread(str(folder / f"{best_s(Episode.load(result.path)):04d}.png"))
    assert shown is not None
    cv2.imwrite(str(out), shown, [cv2.IMWRITE_JPEG_QUALITY, 88])
    return out


def best_s(episode: Episode) -> int:
    """Second at which most others are in front of the car while it goes fast and straight on [s]."""
    ego = episode.ego[::200]
    others = actor_states(episode.steps).position_m[::20]
    count = min(len(ego), len(others))
    position = ego["position_m"][:count, :2]
    ahead = np.gradient(position, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    from_ego = others[:count, :, :2] - position[:, None]
    forward = np.sum(from_ego * ahead[:, None], axis=2)
    aside = ahead[:, None, 0] * from_ego[..., 1] - ahead[:, None, 1] * from_ego[..., 0]
    near = (forward > 4.0) & (forward < NEAR_M) & (np.abs(aside) < 0.6 * forward)
    turn = np.linalg.norm(np.gradient(ahead, axis=0), axis=1)
    good = (ego["speed_mps"][:count] > FAST_MPS) & (turn < STRAIGHT_RAD)
    return int(np.argmax(np.sum(near, axis=1) * good))


if __name__ == "__main__":
    main()
