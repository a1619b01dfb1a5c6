"""Draw RKO-LIO's errors against three quantities of a rig, beside those of an odometry without error.

python docs/findings/effects/curves.py FOLDER …   from folders that `carlaloc sweep` wrote
python docs/findings/effects/curves.py            draws the curves that are kept here again

The odometry without error gives the true poses with the fault alone: at stamps that are wrong by the offset,
or of a body that is turned by the error of the mount. No system can be better, but for luck.
"""

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib
import pandas as pd
from effects import drifts_percent
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from recorder import Metric, Trajectory, evaluate, read_tum
from recorder.evaluation.associate import Association

HERE = Path(__file__).resolve().parent
PICTURE = HERE.parents[1] / "pictures" / "curves.png"
OFFSET, YAW, RATE = "lidar.time_offset_ms", "lidar.calib_yaw_deg", "lidar.rate_hz"
PANELS = {
    OFFSET: ("ape_m", "stamps of the LiDAR late by [ms]", "APE [m]"),
    YAW: ("drift_percent", "written yaw of the LiDAR wrong by [deg]", "drift [%]"),
    RATE: ("ape_m", "sweeps a second", "APE [m]"),
}
"""Of each quantity: its measure, and the labels of both axes."""
SHORT_S = 1
"""Left out at both ends, so that late stamps lie within the truth [s]."""


def measures(truth: Trajectory, estimate: Trajectory) -> dict[str, float]:
    """APE [m] and drift [%]."""
    result = evaluate(truth, estimate, association=Association.INTERPOLATED)
    ape_m = result.statistics[Metric.APE_TRANSLATION].rmse
    return {"ape_m": ape_m, "drift_percent": drifts_percent(truth, estimate)[0]}


def without_error(truth: Trajectory, quantity: str, value: float) -> Trajectory:
    """The true poses, ten a second, with the fault alone."""
    ends_ns = truth.stamp_ns[[0, -1]] + [int(1e9 * SHORT_S), -int(1e9 * SHORT_S)]
    poses = truth.at(pd.RangeIndex(ends_ns[0], ends_ns[1], 100_000_000).to_numpy())
    if quantity == OFFSET:
        return poses.shifted(round(1e6 * value))
    turned = Rotation.from_quat(poses.quat_xyzw) * Rotation.from_euler("z", value, degrees=True)
    return replace(poses, quat_xyzw=turned.as_quat())


def curves(folder: Path) -> Iterator[dict[str, str | float]]:
    """A row for each run of the sweep that varies one of the quantities."""
    for path in sorted((folder / "runs").rglob("rko_lio/*/result.json")):
        score = json.loads(path.read_text("utf-8"))["score"]
        truth = read_tum(folder / "drives" / score["dataset"] / score["town"] / "ground_truth" / "imu.tum")
        found = measures(truth, read_tum(path.with_name("estimate.tum")))
        name = str(path.parent.relative_to(folder))
        changed = "calib" in name or "-" in path.parent.parent.parent.name or "=" in name
        for quantity in PANELS:
            value = re.search(re.escape(quantity) + r"[-=]([0-9.]+)", name)
            if value is None and (changed or quantity == RATE):
                continue
            number = float(value[1]) if value else 0.0
            row: dict[str, str | float] = {
                "town": score["town"],
                "quantity": quantity,
                "value": number,
                **found,
            }
            if quantity != RATE:
                best = measures(truth, without_error(truth, quantity, number))
                row |= {f"best_{measure}": of_best for measure, of_best in best.items()}
            yield row


def main(folders: list[str]) -> None:
    """Keep the curves of a sweep, and draw them."""
    kept = HERE / "curves.csv"
    if folders:
        table = pd.DataFrame(row for folder in folders for row in curves(Path(folder)))
        table = table.drop_duplicates(["town", "quantity", "value"]).sort_values(
            ["quantity", "town", "value"]
        )
        table.to_csv(kept, index=False, float_format="%.4g")
    table = pd.read_csv(kept)
    matplotlib.rcParams.update({"font.size": 9})
    figure = Figure(figsize=(10.5, 3.2), dpi=110, layout="constrained")
    for place, (quantity, (measure, x, y)) in zip(figure.subplots(1, 3), PANELS.items(), strict=True):
        for town, rows in table[table["quantity"] == quantity].groupby("town"):
            (line,) = place.plot(rows["value"], rows[measure], "o-", ms=4, label=f"{town}, RKO-LIO")
            if quantity != RATE:
                best = rows[f"best_{measure}"]
                place.plot(rows["value"], best, "--", color=line.get_color(), label=f"{town}, without error")
        place.set(xlabel=x, ylabel=y, ylim=(0, None))
        place.grid(alpha=0.3)
    figure.axes[0].legend(frameon=False, fontsize=8)
    figure.savefig(PICTURE)


if __name__ == "__main__":
    main(sys.argv[1:])
