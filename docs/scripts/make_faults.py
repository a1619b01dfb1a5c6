"""Write table and picture of the page of faults from the code: ``python docs/scripts/make_faults.py``."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.faults.faults import KINDS, Faults
from carlaloc_env.faults.fields import quantities
from carlaloc_env.faults.timing import TimingFaults
from carlaloc_env.rigs.presets import flu_rig
from carlaloc_env.samples import Image, Imu, PointCloud, Sample

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "robustness" / "faults.md"
AT_NS = 9_000_000_000
PICTURES: tuple[tuple[str, str], ...] = (
    ("sound", ""),
    ("exposure_stops = 2.5", "camera.left.exposure_stops=2.5"),
    ("dirt_share = 0.3", "camera.left.dirt_share=0.3"),
    ("drops_percent = 100, detail", "camera.left.drops_percent=100"),
)
CLOUDS: tuple[tuple[str, str], ...] = (
    ("sound", ""),
    ("dead_beam_share = 0.5", "lidar.dead_beam_share=0.5"),
    ("crosstalk_share = 0.3", "lidar.crosstalk_share=0.3"),
    ("blocked_deg = 120", "lidar.blocked_deg=120"),
)


def table() -> str:
    """All faults as Markdown, those of any sensor first."""
    found: dict[str, list[str]] = {}
    seen: set[str] = set()
    for kind, cls in (("any sensor", TimingFaults), *KINDS.items()):
        for name, known in quantities(cls).items():
            shown = "lidar, camera, gnss, radar" if kind == "lidar" and name.startswith("calib_") else kind
            if name in seen:
                continue
            seen.add(name)
            neutral = "∞" if math.isinf(known.neutral) else f"{known.neutral:g}"
            source = f" ({known.source})" if known.source else ""
            found.setdefault(shown, []).append(
                f"* `{name}` [{known.unit}], {neutral}: {known.definition}{source}"
            )
    lines = [f"**{kind}**\n\n" + "\n".join(faults) for kind, faults in found.items()]
    return "Name [unit], neutral value, definition and source:\n\n" + "\n\n".join(lines)


def page() -> str:
    """The page with today's table."""
    text = PAGE.read_text(encoding="utf-8")
    begin, end = "<!-- table: docs/scripts/make_faults.py -->", "<!-- end of the table -->"
    before, rest = text.split(begin)
    return f"{before}{begin}\n\n{table()}\n\n{end}{rest.split(end)[1]}"


def samples() -> Iterator[Sample]:
    """The left picture and the sweep of an instant of the demo's drive."""
    from recorder.replaying.level_sensors import LevelSensors
    from recorder.replaying.options import ReplayConfig
    from recorder.replaying.plan import plan_replay

    drive = DOCS.parent / "recorder" / "demo" / "town03.mcap"
    config = ReplayConfig(episode=drive, out=Path("out/none"), rig="flu", quality="medium", topics="slam")
    plan = plan_replay(config)
    sensors = LevelSensors(plan.recipe, plan.recipe.levels[0], truth=False)
    yield from (one.sample for one in sensors.measure((AT_NS, AT_NS + 50_000_000)))
    sensors.close()


def draw(path: Path) -> None:
    """One panel for each of some faults."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 7.6), layout="constrained", dpi=110)
    axes = figure.subplots(3, 4)
    found = list(samples())
    image = next(one for one in found if isinstance(one, Image) and one.sensor == "rgb_left")
    cloud = next(one for one in found if isinstance(one, PointCloud) and one.sensor == "lidar")
    configs = {f"{one.kind}.{one.name}": one for one in flu_rig().sensors}
    for place, (title, word) in zip(axes[0], PICTURES, strict=True):
        shown: Any = Faults.parse(filter(None, [word])).apply(image, configs["camera.left"], 3)
        place.imshow(shown.rgb)
        place.set(title=title, xticks=(), yticks=())
        if "drops" in title:  # a detail
            height, width = shown.rgb.shape[:2]
            place.set(xlim=(0.3 * width, 0.7 * width), ylim=(0.7 * height, 0.3 * height))
    for place, (title, word) in zip(axes[1], CLOUDS, strict=True):
        seen: Any = Faults.parse(filter(None, [word])).apply(cloud, configs["lidar.lidar"], 7)
        x, y, z = seen.points_xyz_m.T
        place.scatter(x, y, c=z, s=0.3, cmap="viridis", vmin=-2.0, vmax=6.0)
        place.set(
            title=f"LiDAR: {title}", xlim=(-30, 30), ylim=(-20, 20), aspect="equal", xlabel="forward [m]"
        )
    axes[1, 0].set_ylabel("left [m]")
    _stamps(axes[2, 0], configs["lidar.lidar"])
    _errors(axes[2, 1], configs["imu.imu"])
    _imu(axes[2, 2], configs["imu.imu"], "accel_limit_mps2 = 2", "imu.accel_limit_mps2=2")
    _imu(
        axes[2, 3],
        configs["imu.imu"],
        "accel_bias_mps2 = 1",
        "imu.accel_bias_mps2=1",
        "imu.begin_s=1",
    )
    figure.savefig(path, pil_kwargs={"quality": 82})


def _stamps(axes: Any, config: Any) -> None:
    """Which of 100 sweeps come."""
    words = ("", "lidar.drop_share=0.3", "lidar.burst_share=0.3")
    for row, word in enumerate(words):
        stamps = Faults.parse(filter(None, [word])).stamps_ns(range(0, 5_000_000_000, 50_000_000), config, 2)
        come = np.array([k * 0.05 for k, stamp in enumerate(stamps) if stamp is not None])
        axes.plot(come, np.full(len(come), -row), "|", ms=16)
    axes.set_yticks([0, -1, -2], ["all", "drop_share\n= 0.3", "burst_share\n= 0.3"])
    axes.set(title="sweeps that come", xlabel="time [s]", ylim=(-2.6, 0.6))


def _errors(axes: Any, config: Any) -> None:
    """Errors of stamps over a minute."""
    true = np.arange(0, 60_000_000_000, 200_000_000)
    for word in ("imu.time_offset_ms=3", "imu.time_drift_ppm=100", "imu.time_jitter_ms=0.5"):
        stamps = np.array(Faults.parse([word]).stamps_ns(true.tolist(), config, 2), np.float64)
        axes.plot(true / 1e9, (stamps - true) / 1e6, label=word.removeprefix("imu.").replace("=", " = "))
    axes.legend(fontsize=8, loc="upper left")
    axes.set(title="error of the stamp [ms]", xlabel="time [s]", ylim=(-2.5, 9.5))


def _imu(axes: Any, config: Any, title: str, *words: str) -> None:
    """A swinging specific force, sound and faulty."""
    faults, time_s = Faults.parse(words), np.arange(0.0, 2.0, 0.005)
    sound = 3.0 * np.sin(2 * np.pi * time_s)
    found = []
    for t, value in zip(time_s, sound, strict=True):
        sample = Imu(
            sensor="imu", frame_id="imu", stamp_ns=round(t * 1e9), angular_rate_radps=np.zeros(3),
            specific_force_mps2=np.full(3, value),
        )  # fmt: skip
        faulty: Any = faults.apply(sample, config, 1)
        found.append(faulty.specific_force_mps2[0])
    axes.plot(time_s, sound, "--", color="#888888", label="sound")
    axes.plot(time_s, found, label="faulty")
    axes.legend(fontsize=8, loc="upper right")
    axes.set(title=f"IMU: {title}", xlabel="time [s]", ylabel="specific force [m/s²]", ylim=(-4.5, 6.5))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    draw(DOCS / "pictures" / "faults.jpg")
