"""Write the tables and the picture of docs/realism.md from bags.

python docs/scripts/make_realism.py real=A.bag,B.bag paper=C.bag,D.bag

Each column is measured on its bags; a later bag fills gaps of an earlier one: short ones with clouds and
pictures, and long ones with inertial readings alone. The picture shows a sweep of the first bag.
"""

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from recorder.bags.reader import open_bag
from recorder.dataset.scans import read_scans
from recorder.verification.lidar_metrics import sweeps_of
from recorder.verification.realism import RealismMetric, measure_realism

PAGE = Path(__file__).parents[1] / "realism.md"
PICTURE = PAGE.parent / "pictures" / "realism.png"
BEGIN, END = "<!-- metrics: made by docs/scripts/make_realism.py -->", "<!-- end of metrics -->"
TITLES = {"lidar": "LiDAR", "pictures": "Pictures", "imu": "IMU"}
KITTI_TOPIC = "/oxts/data"
"""Topic of the IMU at KITTI's place, which is compared where a bag has it."""


def main(words: list[str]) -> None:
    """Measure all columns and rewrite the page."""
    bags = {name: [Path(bag) for bag in names.split(",")] for name, names in (w.split("=") for w in words)}
    columns = {name: metrics_of(found) for name, found in bags.items()}
    text = PAGE.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    PAGE.write_text(f"{text[:begin]}\n\n{tables(columns)}\n{text[end:]}", encoding="utf-8")
    draw(next(iter(bags.values()))[0])


def metrics_of(bags: list[Path]) -> dict[str, RealismMetric]:
    """Metrics by name, of the first bag that shows each."""
    found: dict[str, RealismMetric] = {}
    for bag in bags:
        with open_bag(bag) as reader:
            topics = {connection.topic for connection in reader.connections}
        result = measure_realism(bag, imu=KITTI_TOPIC if KITTI_TOPIC in topics else None)
        for metric in result.metrics:
            if metric.name not in found or math.isnan(found[metric.name].value):
                found[metric.name] = metric
    return found


def tables(columns: dict[str, dict[str, RealismMetric]]) -> str:
    """A table for each group; values inside their range are bold."""
    lines: list[str] = []
    first = next(iter(columns.values()))
    for group, title in TITLES.items():
        rows = [metric for metric in first.values() if metric.group == group and metric.low is not None]
        names = " | ".join(f"`{name}`" for name in columns)
        lines += [f"| {title} | real | {names} |", f"|---|---|{'---|' * len(columns)}"]
        for row in rows:
            values = [_value(found.get(row.name)) for found in columns.values()]
            if set(values) == {"–"}:
                continue
            lines.append(f"| {row.name} | {row.low:g} to {row.high:g} | {' | '.join(values)} |")
        judged = [
            [found[row.name].verdict for row in rows if row.name in found] for found in columns.values()
        ]
        counts = [f"{one.count('inside')} of {sum(word != '' for word in one)}" for one in judged]
        lines += [f"| inside | | {' | '.join(counts)} |", ""]
    return "\n".join(lines)


def _value(metric: RealismMetric | None) -> str:
    if metric is None or math.isnan(metric.value):
        return "–"
    size = abs(metric.value)
    text = (
        f"{metric.value:.3f}"
        if size < 0.1
        else f"{metric.value:.3g}"
        if size < 1000
        else f"{metric.value:.0f}"
    )
    return f"**{text}**" if metric.verdict == "inside" else text


def draw(bag: Path) -> None:
    """A sweep from above and from the side, intensities on the road, and residuals along a ring."""
    scans = read_scans(bag)
    scan = next(one for number, (_, one) in enumerate(scans) if number == 10)
    sweep = next(sweeps_of([scan]))
    points, r, intensity = sweep.xyz_m, sweep.range_m, sweep.intensity
    figure, axes = plt.subplots(2, 2, figsize=(11, 9), layout="constrained")
    above = axes[0, 0].scatter(points[..., 0], points[..., 1], c=intensity, s=0.6, cmap="viridis", vmax=60)
    axes[0, 0].set(xlim=(-35, 35), ylim=(-35, 35), aspect="equal", title="from above, by intensity")
    axes[0, 0].set(xlabel="x [m]", ylabel="y [m]")
    figure.colorbar(above, ax=axes[0, 0])
    slab = np.abs(points[..., 1] + 8.0) < 8.0
    axes[0, 1].scatter(points[slab][:, 0], points[slab][:, 2], s=0.6, c="tab:blue")
    axes[0, 1].set(xlim=(-35, 35), ylim=(-3, 9), title="16 m to the right, from the side")
    axes[0, 1].set(xlabel="x [m]", ylabel="z [m]")
    low = np.nanpercentile(points[..., 2][(r > 3) & (r < 15)], 20)
    road = (np.abs(points[..., 2] - low) < 0.15) & (r > 3) & (np.abs(points[..., 1]) < 2.0)
    cosine = np.abs(points[..., 2][road]) / r[road]
    axes[1, 0].scatter(cosine, intensity[road], s=0.6, c="tab:orange")
    axes[1, 0].set(title="own lane: intensity over cosine of incidence", ylim=(0, 30))
    axes[1, 0].set(xlabel="cosine", ylabel="intensity")
    step = np.diff(r, axis=0)
    close = np.abs(step) < 0.1
    axes[1, 1].hist(100 * step[close & (r[1:] < 16)], bins=np.arange(-10.1, 10.2, 0.2), color="tab:green")
    axes[1, 1].set(title="range steps from column to column below 16 m", xlabel="[cm]", xlim=(-10, 10))
    figure.savefig(PICTURE, dpi=80)


if __name__ == "__main__":
    main(sys.argv[1:])
