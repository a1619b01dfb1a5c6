"""Several cars and a unit by the road, from drive to files and scores."""

import csv
import io
import json
import runpy
from collections import defaultdict
from contextlib import redirect_stdout
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import open3d as o3d
import pytest
import yaml
from rosbags.highlevel import AnyReader

from carlaloc_env.core import transforms
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.scene.mesh import EGO_INSTANCE
from recorder.cli.main import main
from recorder.dataset.layout import SequenceFolder
from recorder.episode.episode import Episode
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.options import own_seed

KINDS = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
HALF_M, MIDDLE_M = 0.5 * np.array(EGO_SIZE_M), EGO_REAR_M + 0.5 * EGO_SIZE_M[0]

BAGS = ("rosbag1", "rosbag1_lz4", "rosbag2", "rosbag2_sqlite3")  # bzip2 takes too long to read
UNIT = (140.0, -56.0, 3.5, -20.0)
RIG = {
    "name": "lean",
    "sensors": [
        {"kind": "imu", "mount": {"position_m": [1.4, 0.0, 1.5]}},
        {
            "kind": "lidar",
            "mount": {"position_m": [1.4, 0.0, 1.9]},
            "columns": 360,
            "outputs": ["cloud", "semantic"],
        },
    ],
}


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cars, nine seconds, replayed for both and for a unit by their road."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "lean.yaml").write_text(yaml.safe_dump(RIG))
    drive = ["record", "--map", "Town01", "--cars", "2", "--overlap", "1", "--traffic", "static"]
    assert main([*drive, "--duration", "9", "--seed", "3", "--out", str(folder / "two.mcap")]) == 0
    replayed = ["replay", str(folder / "two.mcap"), "--out", str(folder / "data"), "--car", "all"]
    asked = ["--rig", str(folder / "lean.yaml"), "--traffic", "empty", "--start", "2"]
    asked += ["--format", ",".join((*BAGS, "opv2v", "nuscenes")), "--one-bag"]
    asked += ["--roadside", ",".join(map(str, UNIT))]
    assert main([*replayed, *asked, "--no-preview", "--workers", "1"]) == 0
    return folder


def test_both_cars_have_data_in_one_world_and_their_own_noise(fleet: Path) -> None:
    """Same stamps in both truths, positions of the file, and noise that differs."""
    episode = Episode.load(fleet / "two.mcap")
    truths = [
        read_tum(fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum") for k in (1, 2)
    ]
    np.testing.assert_array_equal(truths[0].stamp_ns, truths[1].stamp_ns)
    for truth, rows in zip(truths, episode.egos, strict=True):
        # The spline runs within a centimetre of the states that control it.
        np.testing.assert_allclose(truth.position_m[0], rows["position_m"][400], atol=0.01)
    seeds = [
        yaml.safe_load((fleet / "data" / f"car{k}" / "dataset.yaml").read_text())["drives"]["Town01"][
            "noise_seed"
        ]
        for k in (1, 2)
    ]
    assert seeds[0] == 3
    assert seeds[1] != 3


def test_truth_between_cars_and_units_is_that_of_all_truths(fleet: Path) -> None:
    """Relative poses and closures of each pair against the truth of both."""
    between, names = fleet / "data" / "between_cars", ("car1", "car2", "roadside1")
    truths = [read_tum(fleet / "data" / k / "Town01" / "ground_truth" / "base_link.tum") for k in names]
    stamps = truths[0].stamp_ns
    T = {k: transforms.transform(one.position_m, one.quat_xyzw) for k, one in zip(names, truths, strict=True)}
    closures = list(csv.DictReader((between / "closures.csv").open()))
    for a, b in combinations(names, 2):
        relative = read_tum(between / f"{a}_{b}.tum")
        rows = np.searchsorted(stamps, relative.stamp_ns)
        expected = transforms.invert(T[a][rows]) @ T[b][rows]
        np.testing.assert_allclose(relative.position_m, expected[:, :3, 3], atol=1e-5)
        found = [row for row in closures if (row["car_a"], row["car_b"]) == (a, b)]
        assert len(found) > 5
        for row in found:
            at = [np.searchsorted(stamps, stamps[0] - 2 * 10**9 + int(row[f"stamp_{c}_ns"])) for c in "ab"]
            pose = transforms.invert(T[a][at[0]]) @ T[b][at[1]]
            np.testing.assert_allclose([float(row[f"{c}_m"]) for c in "xyz"], pose[:3, 3], atol=1e-4)
            assert 0.3 <= float(row["overlap"]) <= 1.0
            # A unit shows its place at all times, so at that of the car.
            assert b != "roadside1" or at[0] == at[1]
    assert list(csv.DictReader((between / "radio.csv").open()))


@pytest.fixture(scope="module")
def scored(fleet: Path) -> dict[str, Any]:
    """Results of KISS-ICP over both cars."""
    pytest.importorskip("kiss_icp")
    said = io.StringIO()
    asked = ["benchmark", str(fleet / "data"), "--methods", "kiss_icp", "--out", str(fleet / "scores")]
    with redirect_stdout(said):
        assert main([*asked, "--json"]) == 0
    result: dict[str, Any] = json.loads(said.getvalue())
    return result


def test_systems_are_scored_together(fleet: Path, scored: dict[str, Any]) -> None:
    """KISS-ICP over both cars: errors of each, of all, and between them; the unit by the road has none."""
    result = scored
    assert len(result["scores"]) == 2
    (row,) = result["cars"]
    assert row["cars"] == 2
    # Alone, as the benchmark scores each; one fit for all cannot be better than a fit for each.
    alone_m = [score["ape_m"] for score in result["scores"]]
    assert [float(text) for text in row["alone_m"].split()] == pytest.approx(alone_m, abs=1e-3)
    assert row["joint_m"] > np.sqrt(np.mean(np.square(alone_m))) - 0.01
    assert row["between_m"] > 0.0
    assert (fleet / "scores" / "cars.csv").is_file()
    assert f"<td>{row['joint_of_m']}</td>" in (fleet / "scores" / "report.html").read_text("utf-8")


def test_the_example_joins_both_cars_without_their_starts(fleet: Path, scored: dict[str, Any]) -> None:
    """Closures alone bring two maps together, and drift less than with true starts."""
    pytest.importorskip("gtsam", reason="gtsam is in the group `peers`")
    assert scored
    example = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "22_join_two_cars.py"))
    known, joined = example["main"](fleet / "data", fleet / "scores")
    assert joined.between_m[0, 1].rmse < 0.2
    assert joined.joint.rmse < known.joint.rmse


def test_what_cannot_be_written_is_refused(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--car 3` of two, one bag of one car, a unit in other words: a line each, nothing written."""
    replayed = ["replay", str(fleet / "two.mcap"), "--out", str(fleet / "third")]
    replayed += ["--rig", str(fleet / "lean.yaml")]
    for more, words in (
        (["--car", "3", "--format", "rosbag2"], "has no car 3; give 1 to 2"),
        (["--car", "2", "--format", "rosbag2", "--one-bag"], "needs several; give --car all"),
        (["--car", "all", "--format", "kitti", "--one-bag"], "needs a format of bags"),
        (["--roadside", "1,2,3", "--format", "rosbag2"], "give x,y,z [m], yaw [deg]"),
        (["--roadside", "1,2,3,4,no_rig", "--format", "rosbag2"], "no_rig"),
    ):
        assert main([*replayed, *more]) == 1
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert words in line
    assert not (fleet / "third").exists()
    assert main(["benchmark", str(fleet / "two.mcap"), "--methods", "no.py", "--out", str(fleet / "no")]) == 1
    assert "two.mcap has 2 cars, the first is scored" in capsys.readouterr().err


def clouds_of(bag: Path, topic: str) -> list[tuple[int, np.ndarray]]:
    """Stamps [ns] and points of the messages of a topic."""
    found = []
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == topic]):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            kind = np.dtype({
                "names": [field.name for field in message.fields],
                "formats": [KINDS[field.datatype] for field in message.fields],
                "offsets": [field.offset for field in message.fields],
                "itemsize": message.point_step,
            })  # fmt: skip
            found.append((stamp.sec * 10**9 + stamp.nanosec, np.frombuffer(message.data, kind)))
    return found


def test_a_unit_by_the_road_stands_still_and_sees_both_cars(fleet: Path) -> None:
    """Constant truth on the cars' clock, its own noise, and points on both cars where their truth is."""
    folder = fleet / "data" / "roadside1" / "Town01"
    truth = read_tum(folder / "ground_truth" / "base_link.tum")
    paths = [fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum" for k in (1, 2)]
    cars = [read_tum(path) for path in paths]
    np.testing.assert_array_equal(truth.stamp_ns, cars[0].stamp_ns)
    np.testing.assert_allclose(truth.position_m, np.tile(UNIT[:3], (len(truth), 1)), atol=1e-6)
    headings = transforms.quat_to_rpy(truth.quat_xyzw)[:, 2]
    np.testing.assert_allclose(np.degrees(headings), UNIT[3], atol=1e-6)
    drive = yaml.safe_load((fleet / "data" / "roadside1" / "dataset.yaml").read_text())["drives"]["Town01"]
    assert drive["roadside"] == {"position_m": list(UNIT[:3]), "yaw_deg": UNIT[3]}
    assert drive["noise_seed"] not in (3, own_seed(3, "car2"))
    T_unit = transforms.transform(np.array(UNIT[:3]), transforms.rpy_to_quat(0, 0, np.radians(UNIT[3])))
    T_unit_lidar = transforms.transform(np.array([1.4, 0.0, 1.9]), np.array([0.0, 0.0, 0.0, 1.0]))
    ids = Episode.load(fleet / "two.mcap").car_ids
    hits = [0, 0]
    clouds = clouds_of(folder / "ClearNoon_empty" / "ClearNoon_empty_ros2", "/lidar/points")
    for stamp, points in clouds:
        assert not np.any(points["id"] == EGO_INSTANCE)
        for k, car in enumerate(cars):
            rows = points[points["id"] == ids[k]]
            at = np.minimum(
                np.searchsorted(car.stamp_ns, stamp + rows["time"].astype(np.float64) * 1e9), len(car) - 1
            )
            xyz = np.stack([rows[name] for name in "xyz"], axis=-1).astype(np.float64)
            world = transforms.apply(T_unit @ T_unit_lidar, xyz)
            local = transforms.quat_rotate(
                transforms.quat_conjugate(car.quat_xyzw[at]), world - car.position_m[at]
            )
            # 2 cm of noise along the ray, and 5 ms of driving at 8 m/s.
            assert np.all(np.abs(local - [MIDDLE_M, 0.0, 0.5 * EGO_SIZE_M[2]]) < HALF_M + 0.1)
            hits[k] += len(rows)
    assert min(hits) > 100
    rows = list(csv.DictReader((fleet / "data" / "between_cars" / "radio.csv").open()))
    assert {(row["car_a"], row["car_b"]) for row in rows} >= {("car1", "car2"), ("car1", "roadside1")}


@pytest.mark.parametrize("kind", BAGS)
def test_one_bag_holds_the_messages_of_all_bags(fleet: Path, kind: str) -> None:
    """Every message of each bag, byte for byte, below its car's name, in the order of time."""

    def messages_of(carrier: str) -> tuple[dict[str, list[tuple[int, bytes]]], dict[str, Any]]:
        path = SequenceFolder(fleet / "data" / carrier / "Town01" / "ClearNoon_empty").place(kind)
        found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        with AnyReader([path]) as reader:
            last_ns = 0
            for connection, at_ns, raw in reader.messages():
                found[connection.topic].append((at_ns, raw))
                assert last_ns <= at_ns
                last_ns = at_ns
            return found, {connection.topic: connection.ext for connection in reader.connections}

    joined, latched = messages_of("all_cars")
    for carrier in ("car1", "car2", "roadside1"):
        own, alone = messages_of(carrier)
        assert latched[f"/{carrier}/tf_static"] == alone["/tf_static"]
        assert len(own["/lidar/points"]) > 100
        for topic, messages in own.items():
            assert joined.pop(f"/{carrier}{topic}") == messages
    assert not joined


def x_to_world(pose: list[float]) -> np.ndarray:
    """OpenCOOD's matrix of a pose in CARLA's axes: the product of yaw, pitch and roll in its signs."""
    x, y, z, roll, yaw, pitch = pose
    cy, sy, cr, sr, cp, sp = (f(np.radians(a)) for a in (yaw, roll, pitch) for f in (np.cos, np.sin))
    return np.array([
        [cp * cy, cy * sp * sr - sy * cr, -cy * sp * cr - sy * sr, x],
        [sy * cp, sy * sp * sr + cy * cr, -sy * sp * cr + cy * sr, y],
        [sp, -cp * sr, cp * cr, z],
        [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip


def test_agents_of_opv2v_agree_in_carlas_world(fleet: Path) -> None:
    """Common frames; clouds, boxes and places of all agents, brought into one world by OpenCOOD's formula."""
    (scenario,) = (path for path in (fleet / "data" / "opv2v").iterdir() if path.is_dir())
    assert (scenario / "data_protocol.yaml").is_file()
    ids = Episode.load(fleet / "two.mcap").car_ids
    agents = sorted(path.name for path in scenario.iterdir() if path.is_dir())
    assert agents == ["-1", *map(str, ids)]
    frames = [sorted(file.stem for file in (scenario / agent).glob("*.yaml")) for agent in agents]
    assert frames[0] == frames[1] == frames[2]
    assert frames[0][:2] == ["00040", "00042"]
    truths = [
        read_tum(fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum") for k in (1, 2)
    ]
    seen = stray = bodies = 0
    for frame in frames[0][::5]:
        tables = {agent: yaml.safe_load((scenario / agent / f"{frame}.yaml").read_text()) for agent in agents}
        places = {agent: table["true_ego_pos"] for agent, table in tables.items()}
        row = (int(frame) - 40) * 10
        for truth, car in zip(truths, ids, strict=True):
            x, y, _ = truth.position_m[row]
            _, _, yaw = np.degrees(transforms.quat_to_rpy(truth.quat_xyzw[row]))
            ahead = MIDDLE_M * np.array([np.cos(np.radians(yaw)), np.sin(np.radians(yaw))])
            np.testing.assert_allclose(places[str(car)][:2], [x + ahead[0], -(y + ahead[1])], atol=1e-3)
            assert (places[str(car)][4] + yaw + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-3)
        for agent, table in tables.items():
            cloud = o3d.io.read_point_cloud(str(scenario / agent / f"{frame}.pcd"))
            red = np.asarray(cloud.colors)[:, 0]
            assert 0.0 <= red.min() < red.max() <= 1.0
            points = np.asarray(cloud.points)
            world = (x_to_world(table["lidar_pose"]) @ np.c_[points, np.ones(len(points))].T).T[:, :3]
            assert agent not in map(str, table["vehicles"])
            for number, box in table["vehicles"].items():
                # OpenCOOD's box: `center` added to `location` in the world.
                pose = [*np.add(box["location"], box["center"]), *box["angle"]]
                up = x_to_world(places[str(number)]) @ [0.0, 0.0, HALF_M[2], 1.0]
                np.testing.assert_allclose(pose[:3], up[:3], atol=0.01)
                np.testing.assert_allclose(pose[3:], places[str(number)][3:], atol=0.2)
                np.testing.assert_allclose(box["extent"], HALF_M, atol=1e-3)
                local = (np.linalg.inv(x_to_world(pose)) @ np.c_[world, np.ones(len(world))].T).T[:, :3]
                inside = np.all(np.abs(local) < HALF_M + 0.06, axis=1)
                assert inside.any()
                # Nothing hangs behind or before a car that has moved meanwhile.
                near = np.all(np.abs(local) < np.add(HALF_M, [0.6, -0.1, -0.1]), axis=1)
                stray, bodies = stray + int(np.sum(near & ~inside)), bodies + int(near.sum())
                seen += int(inside.sum())
    assert seen > 1000
    assert stray < 0.01 * bodies


def test_nuscenes_of_each_car_has_the_other_where_it_was(fleet: Path) -> None:
    """Boxes in the tables of each car: the other one, by the truth of that one, at the sample's stamp."""
    paths = [fleet / "data" / f"car{k}" / "Town01" / "ground_truth" / "base_link.tum" for k in (1, 2)]
    truths = [read_tum(path) for path in paths]
    for own, other in ((0, 1), (1, 0)):
        folder = (
            fleet / "data" / f"car{own + 1}" / "Town01" / "ClearNoon_empty" / "nuscenes" / "v1.0-trainval"
        )
        tables = {
            name: json.loads((folder / f"{name}.json").read_text())
            for name in ("sample", "sample_annotation", "ego_pose", "sample_data")
        }
        at_us = {sample["token"]: sample["timestamp"] for sample in tables["sample"]}
        # The global frame is the world, moved by whole metres.
        pose = tables["ego_pose"][0]
        row = int(np.searchsorted(truths[own].stamp_ns, pose["timestamp"] * 1000))
        origin = np.round(np.subtract(truths[own].position_m[row], pose["translation"]))
        assert len(tables["sample_annotation"]) > 5
        for box in tables["sample_annotation"]:
            row = int(np.searchsorted(truths[other].stamp_ns, at_us[box["sample_token"]] * 1000))
            T = transforms.transform(truths[other].position_m[row], truths[other].quat_xyzw[row])
            middle = transforms.apply(T, np.array([[MIDDLE_M, 0.0, 0.5 * EGO_SIZE_M[2]]]))[0]
            np.testing.assert_allclose(np.add(box["translation"], origin), middle, atol=0.01)
