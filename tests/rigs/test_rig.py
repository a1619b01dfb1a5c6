"""Rigs: YAML there and back, errors that name the next step, spans that lose no sample."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.notes import rig_notes
from carlaloc_env.rigs.presets import RIGS, flu_rig, real_rig, rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig, ReceiverConfig
from carlaloc_env.sensors.vehicle import SpeedConfig


@pytest.mark.parametrize("name", sorted(RIGS))
def test_yaml_round_trip(name: str, tmp_path: Path) -> None:
    """A preset written to a file and read again is equal in every value."""
    rig = rig_by_name(name)
    path = tmp_path / "my_rig.yaml"
    path.write_text(rig.to_yaml(), encoding="utf-8")
    assert rig_by_name(path) == rig
    assert rig_by_name(str(path)) == rig


def test_keys_left_out_keep_their_defaults() -> None:
    text = "sensors:\n- {kind: imu, accel_noise_density: 2e-4}\n- kind: lidar\n  columns: 1085\n"
    assert SensorRig.from_yaml(text).sensors == (
        ImuConfig(accel_noise_density=2e-4),
        LidarConfig(columns=1085),
    )


def test_presets_are_starting_points() -> None:
    """A preset's values, with what the file says on top; written out, all values stand by themselves."""
    text = "sensors:\n- {kind: imu, preset: tactical, rate_hz: 100}\n"
    rig = SensorRig.from_yaml(text)
    expected = ImuConfig(**ImuConfig.preset_values("tactical"), rate_hz=100.0)
    assert rig.sensors == (expected,)
    assert SensorRig.from_yaml(rig.to_yaml()).sensors == (expected,)


def test_presets_with_parts_are_starting_points() -> None:
    """The receiver of a LiDAR's preset stays where a file changes one of its values."""
    values = LidarConfig.preset_values("hdl32e_road")
    for entry, receiver in (
        ("", ReceiverConfig()),
        (", receiver: {reach_m: 40}", ReceiverConfig(reach_m=40.0)),
    ):
        rig = SensorRig.from_yaml(f"sensors:\n- {{kind: lidar, preset: hdl32e_road{entry}}}\n")
        assert rig.sensors == (LidarConfig(**{**values, "receiver": receiver}),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensors: [{kind: imu, acel_noise_density: 1.0}]", "did you mean 'accel_noise_density'"),
        ("sensors: [{kind: lidr}]", "did you mean 'lidar'"),
        ("sensor: []", "did you mean 'sensors'"),
        ("sensors: [{name: imu}]", "'kind' is missing"),
        ("sensors: [{kind: gnss, mount: {position: [0, 0, 0]}}]", "did you mean 'position_m'"),
        ("sensors: [{kind: gnss, mount: {position_m: [0, 0]}}]", "expected 3 values, found 2"),
        ("sensors: [{kind: gnss, mount: {axes: frd}}]", "mount axes 'frd'"),
        ("sensors: [{kind: imu, rate_hz: fast}]", "expected float, found 'fast'"),
        ("sensors: [{kind: imu, rate_hz: 60}]", "does not divide"),
        ("sensors: [{kind: lidar, columns: 10.5}]", "expected int"),
        ("sensors: [{kind: lidar, drop_weak: 1}]", "expected bool"),
        ("sensors: [{kind: imu}, {kind: imu}]", "two imu sensors named 'imu'"),
        ("sensors: [{kind: imu, preset: tactica}]", "did you mean 'tactical'"),
        ("sensors: [{kind: speed, preset: x}]", "no preset of speed 'x'"),
        ("sensors: 3", "must be a list"),
        ("- 1", "expected the keys"),
        ("sensors: [", "not valid YAML"),
    ],
)
def test_mistakes_in_a_file_are_named_in_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=r"my\.yaml|rig 'rig'") as caught:
        SensorRig.from_yaml(text, where="my.yaml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        rig_by_name("missing.yaml")


def test_paper_layout() -> None:
    """Places of the paper's figure about its IMU: cameras ±0.2 m and 0.3 m ahead, LiDAR and GNSS behind."""
    frames = rig_by_name("paper").frames
    to_imu = np.linalg.inv(frames["imu"])

    def about_imu(frame: str) -> np.ndarray:
        return (frames["imu"][:3, :3] @ (to_imu @ frames[frame])[:3, 3]).round(9)

    assert about_imu("camera_left")[:2].tolist() == [0.3, 0.2]
    assert about_imu("camera_right")[:2].tolist() == [0.3, -0.2]
    assert about_imu("lidar")[:2].tolist() == [-0.3, 0.0]
    assert about_imu("gnss")[:2].tolist() == [-0.8, 0.0]
    assert frames["imu"][:3, 0].tolist() == [0, 0, 1], "x of the paper's IMU looks up"
    lidar = rig_by_name("paper").of_kind("lidar")[0]
    assert isinstance(lidar, LidarConfig)
    assert lidar.rays * lidar.rate_hz == pytest.approx(1.33e6, rel=1e-3)


def test_bonnet_is_visible_and_roof_shadows() -> None:
    """The ego's nose projects into the lowest tenth of the picture, its roof does not."""
    from carlaloc_env.assets.model_library import build_library

    library = build_library()
    body = library.meshes[library.index("ego")]
    camera = rig_by_name("paper").of_kind("camera")[0]
    T = np.linalg.inv(camera.mount.T_base_sensor)
    points = body.vertices_m.astype(float) @ T[:3, :3].T + T[:3, 3]
    v = camera.pinhole.project(points)[:, 1]  # type: ignore[attr-defined]
    assert 0.85 * 720 < np.nanmin(v) < 0.97 * 720
    lidar = rig_by_name("paper").of_kind("lidar")[0].mount.position_m
    assert 0.3 < lidar[2] - body.bounds_m[1, 2] < 0.5


def small_rig() -> SensorRig:
    return SensorRig(
        sensors=(
            ImuConfig(),
            LidarConfig(columns=20, elevations_deg=(-10.0, 0.0), mount=Mount(position_m=(0, 0, 2))),
            GnssConfig(),
            SpeedConfig(),
        )
    )


def test_spans_give_every_sample_once_and_late_ones_late(scenery: Any) -> None:
    """Steps of 50 ms add up to the whole; a sweep comes out when it is complete; order is by stamp."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    drive = scenery.drive(scenery.weaving, 1.0)
    rig = small_rig().build(scenery.world([scenery.ground()]))
    whole = rig.measure(drive, -1, 1_000_000_000)
    steps = [rig.measure(drive, -1, 0)]
    steps += [rig.measure(drive, k * 50_000_000, (k + 1) * 50_000_000) for k in range(20)]
    key = {(s.sensor, s.stamp_ns) for s in whole}
    assert len(key) == len(whole) == sum(map(len, steps))
    assert {(s.sensor, s.stamp_ns) for part in steps for s in part} == key
    counts = {name: sum(s.sensor == name for s in whole) for name in rig.streams}
    assert counts == {"imu": 201, "lidar": 20, "lidar_semantic": 20, "gnss": 6, "speed": 21}
    assert [s.sensor for s in steps[1] if s.sensor.startswith("lidar")] == ["lidar", "lidar_semantic"]
    assert next(s for s in steps[1] if s.sensor == "lidar").stamp_ns == 0
    order = [(s.stamp_ns, rig.streams.index(s.sensor)) for s in whole]
    assert order == sorted(order)


def test_streams_of_one_name_are_refused(scenery: Any) -> None:
    rig = SensorRig(sensors=(ImuConfig(name="a"), SpeedConfig(name="a")))
    with pytest.raises(ConfigError, match="two streams named 'a'"):
        rig.build(scenery.world())


def test_a_rig_extends_another_by_what_differs(tmp_path: Path) -> None:
    """64 beams and 30 cm higher are two lines; everything else stays that of the rig `lidar`."""
    path = tmp_path / "high.yaml"
    path.write_text(
        "extends: lidar\nsensors:\n- kind: lidar\n  beams: 64\n  mount: {position_m: [1.2, 0.0, 2.15]}\n"
    )
    plain, high = rig_by_name("lidar"), rig_by_name(path)
    (before,), (after,) = plain.of_kind("lidar"), high.of_kind("lidar")
    assert isinstance(before, LidarConfig)
    assert isinstance(after, LidarConfig)
    assert after.mount.position_m == (*before.mount.position_m[:2], before.mount.position_m[2] + 0.3)
    step_deg = np.diff(after.elevations_deg)
    assert len(after.elevations_deg) == 64
    assert step_deg == pytest.approx(np.full(63, (10.67 + 30.67) / 63))
    assert (after.columns_most, after.elevation_offset_deg, after.firing_ns) == (1085, 0.02, ())
    assert [s for s in high.sensors if s.kind != "lidar"] == [s for s in plain.sensors if s.kind != "lidar"]
    assert SensorRig.from_yaml(high.to_yaml()) == high


def test_beams_take_a_range_and_columns_follow_the_rate() -> None:
    """`beams: 64` between two elevations; an HDL-32E at 10 Hz has twice its columns, or a file's own."""
    text = "extends: lidar\nsensors: [{{kind: lidar, {}}}]\n"
    rigs = [
        SensorRig.from_yaml(text.format(values), bases=RIGS).of_kind("lidar")[0]
        for values in ("beams: 64, elevations_deg: [-25, 15]", "rate_hz: 10", "rate_hz: 10, columns: 900")
    ]
    assert all(isinstance(lidar, LidarConfig) for lidar in rigs)
    wide, slow, own = cast(list[LidarConfig], rigs)
    assert wide.elevations_deg == pytest.approx(np.linspace(-25.0, 15.0, 64))
    assert slow.rays * slow.rate_hz == pytest.approx(694_444, rel=1e-4)
    assert own.rays == 900 * 32


@pytest.mark.parametrize("name", ["os1_64", "vlp16", "mid360", "hdl32e_road", "paper"])
def test_a_preset_replaces_all_of_another_lidar_but_its_place(name: str) -> None:
    text = f"extends: lidar\nsensors: [{{kind: lidar, preset: {name}}}]\n"
    before, after = (
        rig.of_kind("lidar") for rig in (rig_by_name("lidar"), SensorRig.from_yaml(text, bases=RIGS))
    )
    assert after == (LidarConfig(**LidarConfig.preset_values(name), mount=before[0].mount),)


def test_places_that_were_hardly_meant_are_named() -> None:
    text = "extends: flu\nsensors: [{kind: lidar, name: top, preset: os1_64}, {kind: imu, rate_hz: 100}]"
    notes = rig_notes(SensorRig.from_yaml(text, bases=RIGS))
    assert notes[0].startswith("lidar 'top' sits at [0, 0, 0], on the road")
    assert notes[1].startswith("2 LiDARs (lidar, top)")
    assert len(notes) == 2
    assert not rig_notes(rig_by_name("paper"))


def test_an_extended_rig_keeps_axes_and_gets_sensors() -> None:
    """A mount's other values stay; an entry of a new name is a new sensor; a kind of several needs a name."""
    entries = "[{kind: imu, mount: {position_m: [1, 0, 1]}}, {kind: radar, name: back}]"
    text = f"extends: paper\nsensors: {entries}\n"
    paper, rig = rig_by_name("paper"), SensorRig.from_yaml(text, bases=RIGS)
    assert rig.of_kind("imu")[0].mount == Mount(position_m=(1.0, 0.0, 1.0), axes="paper_imu")
    assert [s.name for s in rig.sensors] == [*(s.name for s in paper.sensors), "back"]
    with pytest.raises(ConfigError, match="give the 'name' of the radar to change: front, left, right"):
        SensorRig.from_yaml("extends: paper\nsensors: [{kind: radar, rate_hz: 10}]", bases=RIGS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("extends: lidr", "did you mean 'lidar'"),
        ("extends: [lidar]", "no rig"),
        ("extend: lidar", "did you mean 'extends'"),
        ("extends: lidar\nsensors: [{kind: lidar, beam: 64}]", "unknown key 'beam'|no key 'beam'"),
        ("extends: lidar\nsensors: [{kind: lidar, beams: many}]", "give a whole number from 2 to 256"),
        ("sensors: [{kind: lidar, beams: 8, elevations_deg: [0]}]", "of two figures"),
    ],
)
def test_mistakes_in_an_extension_are_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SensorRig.from_yaml(text, bases=RIGS)


def test_numbers_of_a_rig_are_put_by_kind_and_name() -> None:
    """In a list, keys count; a part that needs another one is refused by its name."""
    for camera in real_rig().with_value("camera.shutter.readout_ms", 20.0).of_kind("camera"):
        assert isinstance(camera, CameraConfig)
        assert camera.shutter is not None
        assert camera.shutter.readout_ms == 20.0
    with pytest.raises(ConfigError, match="a shutter needs an imager"):
        flu_rig().with_value("camera.shutter.readout_ms", 20.0)
    left, right = flu_rig().with_value("camera.right.mount.position_m.1", -0.5).of_kind("camera")
    assert (left, right.mount.position_m[1]) == (flu_rig().of_kind("camera")[0], -0.5)
