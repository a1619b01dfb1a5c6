"""COLMAP's model and nerfstudio's file: read by pycolmap, against labels and depth of a replay."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.bag_samples import cloud_of, rig, truth, write_all
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.samples import Image, SemanticImage
from carlaloc_env.scene.semantic_tags import Tag
from recorder.dataset.layout import SequenceFolder
from recorder.replaying.replay import replay
from recorder.verification.verify import verify
from recorder.writers.formats.colmap import ColmapEncoder, ColmapWriter
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration

EYE = "pinhole: {width_px: 320, height_px: 180, fx_px: 160, fy_px: 160, cx_px: 160, cy_px: 90}"
RIG = f"""\
name: pair
sensors:
- {{kind: lidar, mount: {{position_m: [0.8, 0.0, 1.8]}}, outputs: [cloud, semantic]}}
- {{kind: camera, name: left, mount: {{position_m: [1.3, 0.3, 1.6], axes: optical}}, {EYE},
   outputs: [rgb, depth, semantic]}}
- {{kind: camera, name: right, mount: {{position_m: [1.3, -0.3, 1.6], axes: optical}}, {EYE},
   outputs: [rgb, depth, semantic]}}
"""


@pytest.fixture(scope="module")
def dynamic(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stretch with and without traffic, in two weathers, and the same samples as they are."""
    need_opengl()
    folder = tmp_path_factory.mktemp("colmap")
    (folder / "rig.yaml").write_text(RIG)
    config = straight_drive.config(
        folder / "data", rig=str(folder / "rig.yaml"), formats=("colmap", "raw"), unit_s=10.0, preview=False,
        duration_s=0.6, start_s=1.0, traffic=("dynamic", "static"), weathers=("ClearNoon", "HardRainNoon"),
    )  # fmt: skip
    sequences = map(SequenceFolder, replay(config).sequences)
    return next(one for one in sequences if one.name == "ClearNoon_dynamic").place("colmap")


def raw(folder: Path, stream: str, image: str) -> Any:
    """The sample of a picture's instant as it is."""
    stem = folder.parent / "raw" / stream / image.rpartition("_")[2]
    return np.load(stem.with_suffix(".npz"))["depth_m"] if "depth" in stream else cv2.imread(str(stem), -1)


def model_of(folder: Path) -> Any:
    pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap")
    return pycolmap.Reconstruction(str(folder / "sparse" / "0"))


def seeds_of(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, colours and tags of the seed points."""
    header, data = (folder / "points3D.ply").read_bytes().split(b"end_header\n")
    assert b"property uchar tag" in header
    rows = np.frombuffer(data, [("xyz", "<f4", 3), ("rgb", "u1", 3), ("tag", "u1")])
    return rows["xyz"].astype(float), rows["rgb"], rows["tag"]


@pytest.mark.long
def test_seed_points_lie_within_half_a_pixel_of_their_labels(dynamic: Path) -> None:
    """COLMAP's own camera puts each seed that depth shows into pixels of the seed's tag."""
    model = model_of(dynamic)
    points = np.array([model.points3D[k].xyz for k in sorted(model.points3D)])
    xyz, rgb, tag = seeds_of(dynamic)
    np.testing.assert_allclose(points, xyz, atol=1e-3)
    assert (np.array([model.points3D[k].color for k in sorted(model.points3D)]) == rgb).all()
    assert len(np.unique(tag)) >= 3
    # Painted lines lie in the road, whose label their edges share.
    hits = total = 0
    for image in model.images.values():
        camera = model.cameras[image.camera_id]
        at = transforms.apply(np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]), points)
        uv = np.full((len(at), 2), -1.0)
        ahead = at[:, 2] > 0.5
        uv[ahead] = camera.img_from_cam(at[ahead])
        # COLMAP's first pixel has its middle at 0.5.
        column, row = np.floor(uv).astype(int).T
        inside = (column >= 1) & (row >= 1) & (column < camera.width - 1) & (row < camera.height - 1)
        depth_m = raw(dynamic, f"depth_{image.name.split('_')[0]}", image.name)
        rows = np.flatnonzero(inside)
        shown = rows[np.abs(depth_m[row[rows], column[rows]] - at[rows, 2]) < 0.05 + 0.005 * at[rows, 2]]
        labels = raw(dynamic, f"semantic_{image.name.split('_')[0]}", image.name)
        # Half a pixel reaches the nearest pixel beside the own one, on either axis.
        side = np.where(uv[shown] % 1.0 < 0.5, -1, 1)
        own, beside, below = (
            labels[row[shown] + dy * side[:, 1], column[shown] + dx * side[:, 0]]
            for dx, dy in ((0, 0), (1, 0), (0, 1))
        )
        agrees = (own == tag[shown]) | (beside == tag[shown]) | (below == tag[shown])
        hits, total = hits + int(agrees.sum()), total + len(shown)
    assert total > 5000
    assert hits > 0.995 * total


@pytest.mark.long
def test_a_stereo_pair_triangulates_to_depth(dynamic: Path) -> None:
    """Rays of COLMAP's cameras through one point of both pictures meet at the point's depth."""
    model = model_of(dynamic)
    images = sorted(model.images.values(), key=lambda image: image.name)
    left, right = images[0], images[len(images) // 2]
    depth_m = raw(dynamic, "depth_left", left.name)
    rows, columns = np.nonzero((depth_m > 2.0) & (depth_m < 40.0))
    pick = np.random.default_rng(3).choice(len(rows), 300, replace=False)
    rows, columns = rows[pick], columns[pick]
    eyes = [model.cameras[image.camera_id] for image in (left, right)]
    z = depth_m[rows, columns].astype(float)
    at_left = np.concatenate([eyes[0].cam_from_img(np.stack([columns, rows], 1) + 0.5), np.ones((300, 1))], 1)
    poses = [np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]) for image in (left, right)]
    T_right_left = poses[1] @ np.linalg.inv(poses[0])
    np.testing.assert_allclose(T_right_left, transforms.transform([-0.6, 0, 0], [0, 0, 0, 1]), atol=1e-9)
    at_right = transforms.apply(T_right_left, at_left * z[:, None])
    pixel = eyes[1].img_from_cam(at_right)
    seen = np.concatenate([eyes[1].cam_from_img(pixel), np.ones((300, 1))], 1)
    found = cv2.triangulatePoints(poses[0][:3], poses[1][:3], at_left[:, :2].T, seen[:, :2].T)
    world = (found[:3] / found[3]).T
    np.testing.assert_allclose(transforms.apply(poses[0], world)[:, 2], z, rtol=1e-4)
    # And the right picture has that depth there, wherever it shows the same point.
    column, row = np.floor(pixel).astype(int).T
    inside = (column >= 0) & (column < 320)
    other = raw(dynamic, "depth_right", right.name)[row[inside], column[inside]]
    assert np.mean(np.abs(other - z[inside]) < 0.02 * z[inside]) > 0.85


@pytest.mark.long
def test_both_files_have_the_same_cameras(dynamic: Path) -> None:
    """nerfstudio's axes: x right, y up, z backward."""
    model = model_of(dynamic)
    by_name = {image.name: image for image in model.images.values()}
    frames = json.loads((dynamic / "transforms.json").read_text())["frames"]
    assert len(frames) == len(by_name) == 24
    for frame in frames:
        image = by_name[frame["file_path"].removeprefix("images/")]
        ours = np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
        np.testing.assert_allclose(np.linalg.inv(ours)[:3], image.cam_from_world().matrix(), atol=1e-9)
        camera = model.cameras[image.camera_id]
        assert (frame["fl_x"], frame["cx"], frame["cy"]) == (camera.params[0], *camera.params[2:])
        for key in ("file_path", "mask_path", "depth_file_path"):
            assert (dynamic / frame[key]).is_file()
        # Loaders of splats look for the name without folders.
        assert (dynamic / "images" / Path(image.name).name).is_file()


def off_the_rig(model: Any) -> float:
    """Largest deviation of the right camera's pose in the left one from that of the rig, at any instant."""
    views = model.images.values()
    poses = {view.name: np.vstack([view.cam_from_world().matrix(), [0, 0, 0, 1]]) for view in views}
    rights = {name: T for name, T in poses.items() if name.startswith("right")}
    steps = [T @ np.linalg.inv(poses[name.replace("right", "left")]) for name, T in rights.items()]
    return float(np.abs(np.array(steps) - transforms.transform([-0.6, 0, 0], [0, 0, 0, 1])).max())


@pytest.mark.long
def test_colmap_refines_known_poses_and_keeps_the_pair(dynamic: Path, tmp_path: Path) -> None:
    """Triangulated and adjusted features of the pictures; without the rig's files the pair comes apart."""
    truth_model, model = model_of(dynamic), model_of(dynamic)
    pycolmap = pytest.importorskip("pycolmap")
    features, pictures, apart = tmp_path / "features.db", dynamic / "images", tmp_path / "apart"
    database = pycolmap.Database.open(features)
    for kind in ("camera", "rig", "frame", "image"):
        for entry in getattr(model, f"{kind}s").values():
            getattr(database, f"write_{kind}")(entry, **{f"use_{kind}_id": True})
    database.close()
    extraction = pycolmap.FeatureExtractionOptions(use_gpu=False)
    extraction.sift.peak_threshold = 0.001  # small pictures have few features by the default of 0.0067
    masks = pycolmap.ImageReaderOptions(mask_path=dynamic / "masks")
    pycolmap.extract_features(features, pictures, extraction_options=extraction, reader_options=masks)
    pycolmap.match_exhaustive(features, matching_options=pycolmap.FeatureMatchingOptions(use_gpu=False))
    options = pycolmap.IncrementalPipelineOptions(ba_refine_sensor_from_rig=False)
    options.triangulation.min_angle = options.mapper.filter_min_tri_angle = 1.0
    model = pycolmap.triangulate_points(model, features, pictures, tmp_path, options=options)
    assert model.num_points3D() > 100
    before_px = model.compute_mean_reprojection_error()
    apart.mkdir()
    model.write_text(apart)
    fixed = {"refine_focal_length": False, "refine_extra_params": False, "refine_sensor_from_rig": False}
    pycolmap.bundle_adjustment(model, pycolmap.BundleAdjustmentOptions(**fixed))
    model.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() < before_px < 1.0
    assert off_the_rig(model) < 1e-12
    pairs = [(frame, truth_model.frames[number]) for number, frame in model.frames.items()]
    moves = [frame.rig_from_world * true.rig_from_world.inverse() for frame, true in pairs]
    assert max(np.linalg.norm(move.translation) for move in moves) < 0.01
    assert max(np.degrees(move.rotation.angle()) for move in moves) < 0.1
    for name in ("rigs.txt", "frames.txt"):
        (apart / name).unlink()
    model = pycolmap.Reconstruction(str(apart))
    pycolmap.bundle_adjustment(model, pycolmap.BundleAdjustmentOptions(**fixed))
    assert off_the_rig(model) > 1e-5


@pytest.mark.long
def test_clean_plates_equal_the_picture_where_the_mask_is_white(dynamic: Path) -> None:
    """But for the shadows of road users, which the mask leaves out."""
    movers = 0
    for frame in json.loads((dynamic / "transforms.json").read_text())["frames"]:
        picture = cv2.imread(str(dynamic / frame["file_path"])).astype(int)
        plate = cv2.imread(str(dynamic / frame["clean_plate_path"])).astype(int)
        white = cv2.imread(str(dynamic / frame["mask_path"]), -1) == 255
        apart = np.abs(picture - plate).max(axis=2)
        assert np.mean(apart[white] == 0) > 0.9
        movers += int((apart[~white] > 8).sum())
        assert set(frame["weather_paths"]) == {"HardRainNoon"}
        assert (dynamic / frame["weather_paths"]["HardRainNoon"]).is_file()
        static = (dynamic / frame["clean_plate_path"]).parents[1] / "transforms.json"
        assert "clean_plate_path" not in json.loads(static.read_text())["frames"][0]
    assert movers > 0
    assert verify(dynamic.parents[2]).findings == ()


LENSES = {
    "OPENCV": Lens(model="radtan", coefficients=(-0.2, 0.05, 0.001, -0.002)),
    "OPENCV_FISHEYE": Lens(model="equidistant", coefficients=(0.02, -0.01, 0.003, 0.0)),
}


@pytest.mark.parametrize("model", LENSES)
def test_lenses_are_those_of_colmap(model: str, tmp_path: Path) -> None:
    """Seeds take the colour of the pixel to which COLMAP's camera projects them; movers give none."""
    plain = rig()
    pinhole = Pinhole(width_px=64, height_px=48, fx_px=40, fy_px=40, cx_px=32, cy_px=24)
    eye = CameraCalibration(
        name="left", T_base_camera=plain.cameras[0].T_base_camera, pinhole=pinhole, lens=LENSES[model]
    )
    calibration = RigCalibration.of(cameras=[eye], lidar=plain.lidar)
    assert plain.lidar is not None
    points = np.random.default_rng(1).uniform([4, -3, 0], [20, 3, 4], (400, 3))
    # A picture whose pixels name themselves, its left third a mover's.
    v, u = np.mgrid[:48, :64]
    rgb = np.stack([u, v, np.full_like(u, 9)], axis=-1).astype(np.uint8)
    instance = np.where(u < 20, 1 << 24, 0).astype(np.uint32)
    at = {"frame_id": "camera_left", "stamp_ns": 0}
    seen = transforms.apply(transforms.invert(plain.lidar.T_base_lidar), points)
    samples = [
        truth(0, (0, 0, 0)),
        Image(sensor="rgb_left", rgb=rgb, **at),  # type: ignore[arg-type]
        SemanticImage(sensor="semantic_left", tag=np.zeros((48, 64), np.uint8), instance=instance, **at),  # type: ignore[arg-type]
        cloud_of(seen, 0, tag=Tag.POLE),
        *(truth(stamp, (0, 0, 0)) for stamp in range(5_000_000, 60_000_000, 5_000_000)),
    ]
    encoder = ColmapEncoder(calibration, ("lidar_semantic", "rgb_left", "semantic_left"))
    folder = write_all(ColmapWriter(tmp_path / "colmap", encoder), samples)
    xyz, colours, _ = seeds_of(folder)
    assert len(xyz) > 50
    assert colours[:, 0].min() >= 20
    colmap = model_of(folder)
    camera = colmap.cameras[1]
    assert camera.model.name == model
    image = colmap.images[1]
    local = transforms.apply(np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]), xyz)
    np.testing.assert_array_equal(np.floor(camera.img_from_cam(local)), colours[:, :2])
