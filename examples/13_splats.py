"""Fit splats to a `--format colmap` sequence on a CPU: do masks bring pictures nearer to the clean plate?

pip install "carlaloc[splats]"
carlaloc replay drive.mcap --format colmap --traffic dynamic,static --duration 4 --out data
python examples/13_splats.py data/Town10/ClearNoon_dynamic/colmap
"""

import sys
from pathlib import Path

import numpy as np

try:
    from splatting.fit import colours, fit, lists_of
    from splatting.views import seeds_of, views_of
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[splats]'") from error


def main(
    folder: Path, *, shrink: int = 4, rounds: int = 3, steps: int = 200, every: int = 8
) -> dict[str, list[float]]:
    """PSNR [dB] of held-out views against the clean plate: everywhere, and where traffic hides the town."""
    views = views_of(folder, "left", shrink)
    held_out = views[every // 2 :: every]
    seen = [view for k, view in enumerate(views) if k % every != every // 2]
    seeds, found = seeds_of(seen[:: every - 2]), {}
    for name in ("without masks", "with masks"):
        splats = fit(seen, seeds, masked=name == "with masks", rounds=rounds, steps=steps)
        apart, hidden = [], []
        for view in held_out:
            T = np.broadcast_to(view["T"], (len(view["ray"]), 4, 4))
            drawn = np.asarray(colours(splats, lists_of(view, splats), view["ray"], T))
            # The ego's own body, which is masked and part of the clean plate, does not count.
            town = view["mask"] | (view["plate"] != view["picture"]).any(axis=1)
            apart.append((drawn - view["plate"])[town])
            hidden.append(~view["mask"][town])
        parts = np.concatenate(apart), np.concatenate(apart)[np.concatenate(hidden)]
        found[name] = [float(-10.0 * np.log10(np.mean(part**2))) for part in parts]
        print(f"{name:14}{found[name][0]:6.2f} dB{found[name][1]:7.2f} dB where traffic hides the town")
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]))
