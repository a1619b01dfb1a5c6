"""Errors of RTKLIB's positions with and without reflected signals, which the true labels name.

carlaloc record --map Town10 --device scripted --duration 120 --out drive.mcap
carlaloc replay drive.mcap --rig examples/23_drop_reflections.yaml --format rinex --out data
python examples/23_drop_reflections.py data/Town10/ClearNoon_dynamic/gnss
"""

import csv
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorder import read_trajectory

ALL, KEPT = "gnss.obs", "gnss_kept.obs"


def drop_reflections(folder: Path) -> float:
    """Write the observations without reflected satellites; their share of all."""
    ways: dict[str, dict[str, str]] = {}
    for row in csv.DictReader((folder / "gnss_signals.csv").open()):
        ways.setdefault(row["stamp_ns"], {})[row["satellite"]] = row["way"]
    head, *epochs = re.split("^(?=> )", (folder / ALL).read_text(), flags=re.MULTILINE)
    parts, received, dropped = [head], 0, 0
    for epoch, way in zip(epochs, ways.values(), strict=True):
        first, *lines = epoch.splitlines(keepends=True)
        kept = [line for line in lines if way[line[:3]] != "reflected"]
        parts += [f"{first[:32]}{len(kept):3d}\n", *kept]
        received, dropped = received + len(lines), dropped + len(lines) - len(kept)
    (folder / KEPT).write_text("".join(parts))
    return dropped / received


def main(folder: Path) -> dict[tuple[str, str], NDArray[np.float64]]:
    """Print horizontal errors [m] of RTKLIB's positions, of the car alone and with the base station."""
    print(f"{drop_reflections(folder):.0%} of the received satellites are reflected")
    origin = np.loadtxt(folder / "gnss_truth.pos", comments="%", usecols=(2, 3, 4))[0]
    truth, errors = read_trajectory(folder / "gnss_truth.pos", origin=origin), {}
    for mode, base in {"single": [], "rtk": ["gnss_base.obs"]}.items():
        for rover in (ALL, KEPT):
            words = ["rnx2rtkp", "-k", f"gnss_{mode}.conf", "-o", "out.pos", rover, *base, "gnss.nav"]
            subprocess.run(words, cwd=folder, check=True, capture_output=True)
            found = read_trajectory(folder / "out.pos", origin=origin)
            off = (found.position_m - truth.at(found.stamp_ns).position_m)[:, :2]
            errors[mode, rover] = error = np.hypot(*off.T)
            half, most = np.percentile(error, [50, 95])
            print(f"{mode:<7}{rover:<14}{len(error):4d} positions, median {half:.3f} m, 95 % {most:.3f} m")
    return errors


if __name__ == "__main__":
    main(Path(sys.argv[1]))
