"""nuScenes' layout: a drive in closed form, a replay against its labels, and nuScenes' own devkit."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.bag_samples import cloud_of, rig, truth, write_all

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, ObjectList, RadarScan, Sample
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.build import load_town
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import replay
from recorder.writers.formats.nuscenes import NuscenesEncoder, NuscenesWriter
from recorder.writers.formats.nuscenes_tables import CATEGORIES, lidarseg_table
from recorder.writers.formats.town_ground import PIXEL_M, TownGround, ground_of
from recorder.writers.rig_calibration import RigCalibration

ROOT = Path(__file__).parents[3]
DEVKIT = ROOT / ".nuscenes" / "bin" / "python"
"""An environment of its own: the devkit wants numpy 1 (.ci/optional-tools)."""
SWEEP_NS, STEP_NS, SECONDS = 50_000_000, 50_000_000, 21.4
EGO_MPS, CAR_MPS = 10.0, 15.0
ORIGIN_M = np.array([-100.0, -100.0])
STREAMS = ("lidar_semantic", "rgb_left", "rgb_right", "radar_front")
CAR_ID = 1 << 24
rng = np.random.default_rng(5)
HULL = np.concatenate([rng.uniform(-0.5, 0.5, (40, 3)) * [4.4, 1.8, 1.5] for _ in range(2)])
"""Points of the car from its middle [m]."""
POSTS = rng.uniform([-30, 8, 0], [300, 12, 4], (60, 3))


def calibration() -> RigCalibration:
    plain = rig()
    frames = {**plain.frames, "radar_front": np.eye(4)}
    return RigCalibration(cameras=plain.cameras, imu=plain.imu, lidar=plain.lidar, frames=frames)


def ego_m(stamp_ns: Any) -> np.ndarray:
    x = EGO_MPS * np.asarray(stamp_ns, float) * 1e-9
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=-1)


def car_m(stamp_ns: Any) -> np.ndarray:
    return ego_m(stamp_ns) * CAR_MPS / EGO_MPS * [-1, 1, 1] + [100.0, 3.5, 0.75]


def drive() -> list[Sample]:
    """A car that comes towards the ego, posts beside the road, and a radar that sees one of them."""
    T_base_lidar = calibration().lidar.T_base_lidar  # type: ignore[union-attr]
    samples: list[Sample] = []
    for stamp in range(0, round(SECONDS * 1e9), 5_000_000):
        if stamp % STEP_NS == 0:
            samples.append(
                ObjectList(
                    sensor="objects", frame_id="world", stamp_ns=stamp, id=np.array([CAR_ID], np.uint32),
                    tag=np.array([Tag.CAR], np.uint8), position_m=car_m([stamp]),
                    heading_rad=np.array([np.pi]),
                    pitch_rad=np.zeros(1), roll_rad=np.zeros(1), size_m=np.array([[4.5, 1.9, 1.6]]),
                    velocity_mps=np.array([[-CAR_MPS, 0.0, 0.0]]), yaw_rate_radps=np.zeros(1),
                    visible=np.array([0.7]), distance_m=np.ones(1),
                )
            )  # fmt: skip
        samples.append(truth(stamp, ego_m(stamp), (0, 0, 0, 1)))
        if stamp % SWEEP_NS:
            continue
        offset = np.linspace(0, SWEEP_NS - 1, len(HULL) + len(POSTS)).astype(np.uint32)
        when = stamp + offset[: len(HULL)].astype(np.int64)
        world = np.concatenate([car_m(when) + HULL, POSTS])
        in_base = world - ego_m(stamp + offset.astype(np.int64))
        seen = transforms.apply(transforms.invert(T_base_lidar), in_base)
        instance = np.repeat([CAR_ID, 0], [len(HULL), len(POSTS)])
        tag = np.repeat([Tag.CAR, Tag.POLE], [len(HULL), len(POSTS)])
        samples.append(cloud_of(seen, stamp, offset_ns=offset, tag=tag, instance=instance, ring=7))
        post = np.array([40.0, 9.0, 0.0])
        distance = np.float32(np.hypot(*post[:2]))
        single = {name: np.zeros(1, np.float32) for name in ("elevation_rad", "snr_db", "rcs_dbsm")}
        samples.append(
            RadarScan(
                sensor="radar_front", frame_id="radar_front", stamp_ns=stamp, range_m=np.array([distance]),
                azimuth_rad=np.array([np.arctan2(9.0, 40.0)], np.float32),
                doppler_mps=np.array([-EGO_MPS * 40.0 / distance], np.float32), tag=np.zeros(1, np.uint8),
                instance=np.zeros(1, np.uint32), origin=np.zeros(1, np.uint8), **single,
            )
        )  # fmt: skip
        if stamp % 100_000_000 == 0:
            samples += [
                Image(sensor=f"rgb_{side}", frame_id=f"camera_{side}", stamp_ns=stamp,
                      rgb=np.full((24, 32, 3), 90, np.uint8))
                for side in ("left", "right")
            ]  # fmt: skip
    return samples


def ground() -> TownGround:
    """A parked car beside the road."""
    return TownGround(
        name="Straight", origin_m=ORIGIN_M, mask=np.full((40, 30), 255, np.uint8),
        parked_centre_m=np.array([[20.0, 10.0, 1.0]]), parked_heading_rad=np.array([0.5]),
        parked_size_m=np.array([[30.0, 4.0, 4.0]]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    encoder = NuscenesEncoder(calibration(), STREAMS)
    target = tmp_path_factory.mktemp("nuscenes") / "nuscenes"
    return write_all(NuscenesWriter(target, encoder, ground=ground, about={"name": "A_dynamic"}), drive())


class Tables:
    """Tables of a folder by name and token."""

    def __init__(self, root: Path) -> None:
        self.root = root
        files = (root / "v1.0-trainval").glob("*.json")
        self.rows = {file.stem: json.loads(file.read_text()) for file in files}
        self.by_token = {name: {row["token"]: row for row in rows} for name, rows in self.rows.items()}
        self.channel = {
            row["token"]: self.by_token["sensor"][row["sensor_token"]]["channel"]
            for row in self.rows["calibrated_sensor"]
        }

    def clouds(self) -> list[dict[str, Any]]:
        return [row for row in self.rows["sample_data"]
                if self.channel[row["calibrated_sensor_token"]] == "LIDAR_TOP"]  # fmt: skip

    def to_world(self, row: dict[str, Any]) -> np.ndarray:
        """Maps a measurement's sensor frame to nuScenes' global one."""
        mount = self.by_token["calibrated_sensor"][row["calibrated_sensor_token"]]
        T: np.ndarray = matrix(self.by_token["ego_pose"][row["ego_pose_token"]]) @ matrix(mount)
        return T

    def points(self, row: dict[str, Any]) -> np.ndarray:
        """A sweep's points in the global frame."""
        points = np.fromfile(self.root / row["filename"], "<f4").reshape(-1, 5)
        return transforms.apply(self.to_world(row), points[:, :3].astype(float))

    def boxes(self, sample: str) -> list[dict[str, Any]]:
        return [row for row in self.rows["sample_annotation"] if row["sample_token"] == sample]


def matrix(row: dict[str, Any]) -> np.ndarray:
    w, x, y, z = row["rotation"]
    return transforms.transform(row["translation"], [x, y, z, w])


def is_in(box: dict[str, Any], points_m: np.ndarray) -> np.ndarray:
    width, length, height = box["size"]
    local = transforms.apply(transforms.invert(matrix(box)), points_m)
    inside: np.ndarray = (np.abs(local) <= 0.5 * np.array([length, width, height])).all(axis=1)
    return inside


def test_every_row_points_to_rows_and_files_that_are_there(folder: Path) -> None:
    tables = Tables(folder)
    for name, rows in tables.rows.items():
        assert len(tables.by_token[name]) == len(rows)
        for row in rows:
            for key, value in row.items():
                of = key.removesuffix("_token").removeprefix("first_").removeprefix("last_")
                of = {"annotation": "sample_annotation", "prev": name, "next": name}.get(of, of)
                if (key.endswith("_token") or key in ("prev", "next")) and value:
                    assert value in tables.by_token[of], (name, key)
    for row in tables.rows["sample_data"] + tables.rows["map"] + tables.rows["lidarseg"]:
        assert (folder / row["filename"]).is_file()
    written = {path.relative_to(folder).as_posix() for kind in ("samples", "sweeps")
               for path in (folder / kind).rglob("*.*")}  # fmt: skip
    assert written == {row["filename"] for row in tables.rows["sample_data"]}


def test_samples_come_twice_a_second_in_scenes_of_twenty(folder: Path) -> None:
    tables = Tables(folder)
    assert [scene["nbr_samples"] for scene in tables.rows["scene"]] == [40, 3]
    times = np.array([sample["timestamp"] for sample in tables.rows["sample"]])
    assert set(np.diff(times)) == {500_000}
    assert times[0] == 1_672_531_200_000_000
    first = tables.rows["sample"][0]["token"]
    assert {
        tables.channel[row["calibrated_sensor_token"]]
        for row in tables.rows["sample_data"]
        if row["is_key_frame"] and row["sample_token"] == first
    } == {"LIDAR_TOP", "CAM_FRONT", "CAM_RIGHT", "RADAR_FRONT"}
    # A sweep between samples belongs to the one that follows.
    between = next(row for row in tables.clouds() if not row["is_key_frame"])
    assert tables.by_token["sample"][between["sample_token"]]["timestamp"] == times[1]


def test_points_boxes_and_pictures_are_of_one_instant(folder: Path) -> None:
    """Each point was seen at its own time, by and of things that move."""
    tables = Tables(folder)
    for row in tables.clouds()[::7]:
        stamp = (row["timestamp"] - 1_672_531_200_000_000) * 1000
        points = tables.points(row) + np.array([*ORIGIN_M, 0.0])
        np.testing.assert_allclose(points, np.concatenate([car_m(stamp) + HULL, POSTS]), atol=2e-5)
    for row in (row for row in tables.clouds() if row["is_key_frame"]):
        points = tables.points(row)
        near = [box for box in tables.boxes(row["sample_token"]) if box["size"][1] < 10]
        for box in near:
            assert box["num_lidar_pts"] == is_in(box, points).sum() >= len(HULL)
            assert box["visibility_token"] == "3"


def test_boxes_have_their_instance_attribute_and_pace(folder: Path) -> None:
    tables = Tables(folder)
    instances = tables.by_token["instance"]
    category = {token: tables.by_token["category"][row["category_token"]]["name"]
                for token, row in instances.items()}  # fmt: skip
    assert set(category.values()) == {"vehicle.car"}
    attributes = {
        tables.by_token["attribute"][row["attribute_tokens"][0]]["name"]: row
        for row in tables.rows["sample_annotation"]
    }
    assert set(attributes) == {"vehicle.moving", "vehicle.parked"}
    assert attributes["vehicle.parked"]["size"] == pytest.approx([4.1, 30.1, 4.1])
    for row in tables.rows["sample_annotation"]:
        if row["next"] and row["size"][1] < 10:
            following = tables.by_token["sample_annotation"][row["next"]]
            step = np.subtract(following["translation"], row["translation"])
            np.testing.assert_allclose(step, [-0.5 * CAR_MPS, 0, 0], atol=1e-9)


def test_points_have_the_labels_of_lidarseg(folder: Path) -> None:
    tables = Tables(folder)
    labels = np.fromfile(folder / tables.rows["lidarseg"][0]["filename"], np.uint8)
    names = np.array(CATEGORIES)[labels]
    assert (names == np.repeat(["vehicle.car", "static.manmade"], [len(HULL), len(POSTS)])).all()
    assert CATEGORIES[lidarseg_table()[Tag.SNOW]] == "noise"


def test_what_stands_has_no_speed_over_the_ground(folder: Path) -> None:
    """nuScenes' devkit keeps detections of these states; `vx_comp` is without the car's own motion."""
    file = sorted((folder / "samples" / "RADAR_FRONT").iterdir())[3]
    header, rows = file.read_bytes().split(b"DATA binary\n")
    assert b"WIDTH 1\n" in header
    x, y, _ = np.frombuffer(rows[:12], "<f4")
    assert (x, y) == pytest.approx((40.0, 9.0), abs=1e-4)
    vx, _, vx_comp, vy_comp = np.frombuffer(rows[19:35], "<f4")
    assert vx == pytest.approx(-EGO_MPS * 40.0**2 / (40.0**2 + 9.0**2), abs=1e-4)
    assert (vx_comp, vy_comp) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert list(rows[35:37]) == [1, 3]


def test_lenses_are_straightened(folder: Path) -> None:
    """A straight edge of the world is straight in the JPEG, and was not in the picture."""
    lens = Lens(model="radtan", coefficients=(-0.28, 0.07, 0.0, 0.0))
    pinhole = Pinhole(width_px=320, height_px=240, fx_px=160, fy_px=160, cx_px=160, cy_px=120)
    camera = replace(rig().cameras[0], lens=lens, pinhole=pinhole)
    x, y = lens.rays(pinhole)[..., 0], lens.rays(pinhole)[..., 1]
    rgb = np.repeat(np.where(y > 0.45, 230, 20)[..., None], 3, axis=2).astype(np.uint8)
    assert x.shape == rgb.shape[:2]
    encoder = NuscenesEncoder(replace(calibration(), cameras=(camera,)), STREAMS)
    image = Image(sensor="rgb_left", frame_id="camera_left", stamp_ns=0, rgb=rgb)
    decoded = cv2.imdecode(np.frombuffer(encoder.encode(image)[0].data, np.uint8), cv2.IMREAD_GRAYSCALE)
    edge = (np.asarray(decoded)[:, 40:280] < 128).sum(axis=0)
    assert np.ptp(edge) <= 1
    assert edge[0] == pytest.approx(120 + 0.45 * 160, abs=1.5)
    assert np.ptp((rgb[:, 40:280, 0] < 128).sum(axis=0)) > 4


def test_without_a_lidar_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(WriterError, match="needs a LiDAR; add one"):
        NuscenesEncoder(RigCalibration(), ())


def test_the_mask_is_where_lanes_are(straight_map: Path) -> None:
    """Lane centres are inside, points beside all lanes are not; rows run from north to south."""
    town = load_town(straight_map)
    found = ground_of(town, parked_cars=False)
    centre = town.network.tables.position_m[:, :2]
    paved = np.array([lane.type in ("driving", "sidewalk") for lane in town.network.lanes])
    owner = np.repeat(np.arange(len(paved)), town.network.tables.count)
    cell = np.floor((centre[paved[owner]] - found.origin_m) / PIXEL_M).astype(int)
    assert (found.mask[len(found.mask) - 1 - cell[:, 1], cell[:, 0]] == 255).all()
    lanes = [k for k, lane in enumerate(town.network.lanes) if paved[k]]
    area = sum(float(town.network.tables.length_m[k] * np.mean(town.network.tables.width_m[owner == k]))
               for k in lanes)  # fmt: skip
    assert (found.mask > 0).sum() * PIXEL_M**2 == pytest.approx(area, rel=0.06)


@pytest.fixture(scope="module")
def replayed(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive among many, seen by a LiDAR alone."""
    folder = tmp_path_factory.mktemp("replayed")
    traffic = "dynamic,vehicles=20,walkers=0"
    drive = RecordConfig(map=str(straight_drive.town), out=folder / "a.mcap", duration_s=3.0, traffic=traffic)
    (folder / "rig.yaml").write_text("name: one\nsensors:\n- {kind: lidar, mount: {position_m: [1, 0, 2]}}\n")
    config = straight_drive.config(
        folder / "data", episode=record(drive).path, rig=str(folder / "rig.yaml"), formats=("nuscenes",),
        preview=False, unit_s=10.0,
    )  # fmt: skip
    return replay(config).sequences[0] / "nuscenes"


@pytest.mark.long
def test_boxes_hold_the_points_of_vehicles(replayed: Path) -> None:
    tables = Tables(replayed)
    vehicle = [k for k, name in enumerate(CATEGORIES) if name.startswith(("vehicle", "human"))]
    inside = total = 0
    for row in (row for row in tables.clouds() if row["is_key_frame"]):
        labels = next(seg for seg in tables.rows["lidarseg"] if seg["sample_data_token"] == row["token"])
        own = np.isin(np.fromfile(replayed / labels["filename"], np.uint8), vehicle)
        points = tables.points(row)[own]
        held = np.zeros(len(points), bool)
        for box in tables.boxes(row["sample_token"]):
            held |= is_in(box, points)
        inside, total = inside + int(held.sum()), total + len(points)
    assert total > 50
    assert inside >= 0.95 * total


SCRIPT = """
import sys, json
import matplotlib
matplotlib.use("Agg")
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from nuscenes.utils.geometry_utils import points_in_box
n = NuScenes("v1.0-trainval", sys.argv[1], verbose=False)
sample = n.sample[1]
n.render_sample(sample["token"], out_path=sys.argv[2], verbose=False)
counts = []
path, boxes, _ = n.get_sample_data(sample["data"]["LIDAR_TOP"])
cloud = LidarPointCloud.from_file(path)
for box in boxes:
    row = n.get("sample_annotation", box.token)
    counts.append([int(points_in_box(box, cloud.points[:3]).sum()), row["num_lidar_pts"]])
merged, _ = LidarPointCloud.from_file_multisweep(n, sample, "LIDAR_TOP", "LIDAR_TOP", nsweeps=5)
radar = RadarPointCloud.from_file(n.get_sample_data_path(sample["data"]["RADAR_FRONT"])).nbr_points()
speeds = [float(abs(n.box_velocity(token)[0])) for token in sample["anns"]]
_, _, K = n.get_sample_data(sample["data"]["CAM_FRONT"])
print(json.dumps({
    "counts": counts, "merged": merged.nbr_points(), "cloud": cloud.nbr_points(), "radar": radar,
    "speeds": speeds, "K": K.tolist(), "tracks": len(n.instance),
}))
"""


@pytest.mark.long
def test_the_devkit_opens_it(folder: Path, tmp_path: Path) -> None:
    if not DEVKIT.exists():
        pytest.skip("needs nuscenes-devkit in .nuscenes (.ci/optional-tools)")
    picture = tmp_path / "sample.png"
    words = [str(DEVKIT), "-c", SCRIPT, str(folder), str(picture)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env={"PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["counts"]
    assert all(theirs == ours for theirs, ours in found["counts"])
    assert found["merged"] == 5 * found["cloud"] == 5 * (len(HULL) + len(POSTS))
    assert found["radar"] == 1
    assert sorted(found["speeds"]) == pytest.approx([0.0, CAR_MPS], abs=1e-6)
    assert found["K"] == rig().cameras[0].pinhole.K.tolist()
    assert found["tracks"] == 2
    assert picture.stat().st_size > 20_000
