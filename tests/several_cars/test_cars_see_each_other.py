"""A recorded drive of two cars: each is where its spline is, for rays, truth and pictures of the other."""

from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from carlaloc_env.assets.model_library import build_library
from carlaloc_env.core import transforms
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.core.errors import ConfigError, EpisodeError
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.actor_boxes import boxes_at
from carlaloc_env.timeline.driven_cars import MODEL
from carlaloc_env.town.build import load_town
from carlaloc_env.weather.schedule import weather_of
from recorder.demo.story import DEMO_DRIVE
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.repair import repair_episode
from recorder.episode.traffic_level import traffic_level
from recorder.laboratory.between_cars import contact_times, relative_motion

CENTRE_M = EGO_REAR_M + 0.5 * EGO_SIZE_M[0]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve seconds of two cars on one route, 15 m apart at the start: the first accelerates and brakes."""
    path = tmp_path_factory.mktemp("cars") / "two.mcap"
    record(RecordConfig(map="Town01", out=path, cars=2, overlap=1.0, traffic="0.1", duration_s=12.0, seed=3))
    return path


def test_files_hold_all_cars_and_read_back_as_each(drive: Path) -> None:
    """Both cars' rows, devices and routes; each is the other's actor, by the id in the header."""
    first, second = (Episode.load(drive, car=number) for number in (1, 2))
    assert len(first.egos) == 2
    assert len(first.header.cars) == 2
    assert first.header.route["start"] == 0.0
    assert second.header.route["start"] > 0.0
    begins_m = [episode.ego["position_m"][0] for episode in (first, second)]
    assert 14.0 < np.linalg.norm(begins_m[0] - begins_m[1]) < 16.0
    ids = [int(car["id"]) for car in first.header.cars]
    assert len({*ids, *first.header.catalog.id.tolist()}) == 2 + len(first.header.catalog)
    for own, other, episode in ((0, 1, first), (1, 0, second)):
        catalog = episode.timeline().catalog
        assert catalog.id[-1] == ids[other]
        assert ids[own] not in catalog.id
        assert catalog.model[-1] == MODEL
    with pytest.raises(EpisodeError, match="no car 3; give 1 to 2"):
        Episode.load(drive, car=3)


@pytest.mark.parametrize("level", ["dynamic", "static", "empty", "0.5"])
def test_cars_remain_at_every_level_of_traffic(drive: Path, level: str) -> None:
    """Whatever traffic is left out, the other car is there."""
    timeline = traffic_level(level).select(Episode.load(drive).timeline())
    assert timeline.catalog.model[-1] == MODEL
    assert len(timeline.catalog) == (1 if level in ("static", "empty") else len(timeline.catalog))
    frame = timeline.actors_at(1_234_000_000)
    assert len(frame) == len(timeline.catalog)


def test_rays_and_relative_truth_agree_to_a_millimetre(drive: Path) -> None:
    """Hits on the other car at any time, brought into its frame by the relative truth, lie on its mesh."""
    episode = Episode.load(drive)
    a, b = episode.timeline(), Episode.load(drive, car=2).timeline()
    town, library = load_town("Town01"), build_library()
    stage = SensorStage(town, seed=0, weather=weather_of("ClearNoon"))
    mesh = library.meshes[library.index(MODEL)]
    surface = o3d.t.geometry.RaycastingScene()
    surface.add_triangles(
        o3d.core.Tensor(np.asarray(mesh.vertices_m, np.float32)),
        o3d.core.Tensor(np.asarray(mesh.triangles, np.uint32)),
    )
    worst_m, linear_m, hits = 0.0, 0.0, 0
    # Thirds of steps and of ticks: neither grid.
    for stamp in range(2 * 10**9 + 16_666_667, 11 * 10**9, 450_000_000):
        at = np.array([stamp])
        relative = relative_motion(a, b, at)
        T_a_b = transforms.transform(relative.position_m[0], relative.quat_xyzw[0])
        if np.linalg.norm(T_a_b[:3, 3]) > 28.0:
            continue
        T_world_a = a.ego_motion(at).T_world_frame[0]
        eye_m = transforms.apply(T_world_a, np.array([[0.7, 0.0, 1.9]]))[0]
        rng = np.random.default_rng(stamp)
        places = rng.uniform([-0.9, -0.9, 0.3], [3.7, 0.9, 1.4], (400, 3))
        aims = transforms.apply(T_world_a @ T_a_b, places)
        directions = (aims - eye_m) / np.linalg.norm(aims - eye_m, axis=1)[:, None]
        origins, stamps = np.tile(eye_m, (len(aims), 1)), np.full(len(aims), stamp)
        found = stage.rays().cast(origins, directions, stamps, a, 60.0, ego=False)
        rows = found.instance == a.catalog.id[-1]
        assert rows.sum() > 100
        points = origins[rows] + directions[rows] * found.range_m[rows, None]
        in_a = transforms.apply(transforms.invert(T_world_a), points)
        in_b = transforms.apply(transforms.invert(T_a_b), in_a) - [CENTRE_M, 0.0, 0.0]
        away = surface.compute_distance(o3d.core.Tensor(in_b.astype(np.float32))).numpy()
        # Front wheels are turned in steps for rays: they are left out.
        body = in_b[:, 2] > 0.7
        worst_m, hits = max(worst_m, float(away[body].max())), hits + int(body.sum())
        steps = np.array([stamp // STEP_NS * STEP_NS, (stamp // STEP_NS + 1) * STEP_NS])
        ends = b.ego_motion(steps).position_m
        share = (stamp % STEP_NS) / STEP_NS
        straight = ends[0] + share * (ends[1] - ends[0])
        linear_m = max(linear_m, float(np.linalg.norm(straight - b.ego_motion(at).position_m[0])))
    stage.close()
    assert hits > 500
    assert worst_m < 1e-3
    # A car that moved straight between steps would be off by more.
    assert linear_m > 5e-4


def test_boxes_have_pitch_roll_and_the_splines_speed(drive: Path) -> None:
    """Boxes of the other car: its attitude and velocity, as the derivative of its spline has them."""
    a, b = Episode.load(drive).timeline(), Episode.load(drive, car=2).timeline()
    pitches = []
    for stamp in range(3 * 10**9 + 7_000_000, 11 * 10**9, 777_000_000):
        boxes, motion = boxes_at(a, stamp), b.ego_motion([stamp])
        R = transforms.quat_to_matrix(motion.quat_xyzw)[0]
        np.testing.assert_allclose(boxes.axes[-1], R.T, atol=1e-6)
        middle = motion.position_m[0] + R @ np.array([CENTRE_M, 0.0, 0.5 * EGO_SIZE_M[2]])
        np.testing.assert_allclose(boxes.centre_m[-1], middle, atol=1e-4)
        around = b.ego_motion(np.array([stamp - TICK_NS, stamp + TICK_NS]))
        points = around.position_m + transforms.quat_rotate(
            around.quat_xyzw, np.tile([CENTRE_M, 0.0, 0.0], (2, 1))
        )
        np.testing.assert_allclose(boxes.velocity_mps[-1], (points[1] - points[0]) / 0.01, atol=0.02)
        pitches.append(abs(float(boxes.pitch_rad[-1])))
        assert boxes.tag[-1] == Tag.CAR
    assert max(pitches) > 1e-3


def test_radio_contact_follows_from_distances(drive: Path) -> None:
    """Times within a range, against distances of the recorded rows."""
    episode = Episode.load(drive)
    stamps = np.arange(0, 11 * 10**9, STEP_NS)
    relative = relative_motion(episode.timeline(), Episode.load(drive, car=2).timeline(), stamps)
    ticks = stamps // TICK_NS
    rows_m = np.linalg.norm(
        episode.egos[0]["position_m"][ticks] - episode.egos[1]["position_m"][ticks], axis=1
    )
    found = contact_times(relative, 16.0)
    inside = np.zeros(len(stamps), bool)
    for begin, end, _ in found:
        inside |= (stamps >= begin) & (stamps <= end)  # type: ignore[operator]
    clear = np.abs(rows_m - 16.0) > 0.01
    np.testing.assert_array_equal(inside[clear], rows_m[clear] <= 16.0)
    assert contact_times(relative, 1.0) == []


def test_a_cut_off_recording_of_two_cars_is_repaired(drive: Path, tmp_path: Path) -> None:
    """What a killed recorder leaves becomes a whole file with both cars."""
    cut = tmp_path / "cut.mcap.recording"
    cut.write_bytes(drive.read_bytes()[: int(0.7 * drive.stat().st_size)])
    whole = repair_episode(cut)
    original = Episode.load(drive)
    assert whole.complete
    for rows, known in zip(whole.egos, original.egos, strict=True):
        assert 200 < len(rows) < len(known)
        np.testing.assert_array_equal(rows["position_m"], known["position_m"][: len(rows)])


def test_bad_numbers_of_cars_are_refused(tmp_path: Path) -> None:
    """Before anything is built or written."""
    with pytest.raises(ConfigError, match="17 cars; give 1 to 16"):
        RecordConfig(out=tmp_path / "a.mcap", cars=17)
    with pytest.raises(ConfigError, match=r"overlap 1\.5"):
        RecordConfig(out=tmp_path / "a.mcap", cars=2, overlap=1.5)


def test_a_unit_by_the_road_sees_the_car_of_a_drive_of_one() -> None:
    """The car is an actor at its spline, with an id of its own; at every level of traffic."""
    episode = Episode.load(DEMO_DRIVE)
    own, unit = episode.timeline(), episode.timeline(np.eye(4))
    for level in ("dynamic", "empty"):
        seen = traffic_level(level).select(unit)
        assert seen.catalog.model[-1] == MODEL
        assert int(seen.catalog.id[-1]) == episode.car_ids[0]
        assert episode.car_ids[0] not in own.catalog.id
        stamp = 20_003_000_000
        motion, boxes = own.ego_motion([stamp]), boxes_at(seen, stamp)
        middle = transforms.apply(motion.T_world_frame[0], np.array([[CENTRE_M, 0.0, 0.5 * EGO_SIZE_M[2]]]))
        np.testing.assert_allclose(boxes.centre_m[-1], middle[0], atol=1e-4)
        np.testing.assert_array_equal(seen.ego_motion([stamp]).T_world_frame[0], np.eye(4))
