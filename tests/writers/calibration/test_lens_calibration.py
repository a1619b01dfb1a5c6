"""Distorted pictures and the calibration files written beside them, undone again by OpenCV."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imaging.frame import Frame, Optics
from carlaloc_env.weather.presets import PRESETS
from recorder.writers.calibration.files import write_calibration
from recorder.writers.rig_calibration import RigCalibration

RADTAN = Lens(model="radtan", coefficients=(-0.28, 0.07, 0.0002, 2e-5))
"""About that of EuRoC's cameras."""
FISHEYE = Lens(model="equidistant", coefficients=(-0.01, 0.02, -0.013, 0.003))
"""About that of TUM-VI's."""
CAMERA = Pinhole(width_px=320, height_px=200, fx_px=190.0, fy_px=190.0, cx_px=157.0, cy_px=103.0)
LENSES = pytest.mark.parametrize("lens", [RADTAN, FISHEYE], ids=["radtan", "equidistant"])


def undistorted(lens: Lens, points_px: Any) -> Any:
    """OpenCV's answer: normalised coordinates of pixels (N, 2)."""
    points = np.asarray(points_px, np.float64).reshape(-1, 1, 2)
    k = np.array(lens.coefficients)
    if lens.model == "radtan":
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
        return cv2.undistortPoints(points, CAMERA.K, k, criteria=criteria).reshape(-1, 2)
    return cv2.fisheye.undistortPoints(points, CAMERA.K, k).reshape(-1, 2)


@LENSES
def test_rays_are_those_of_opencv(lens: Lens) -> None:
    v, u = np.mgrid[: CAMERA.height_px : 7, : CAMERA.width_px : 9]
    expected = undistorted(lens, np.stack([u, v], -1).reshape(-1, 2))
    rays = lens.rays(CAMERA)[::7, ::9].reshape(-1, 2)
    np.testing.assert_allclose(rays, expected, atol=2e-6)


@LENSES
def test_distortion_is_that_of_opencv(lens: Lens) -> None:
    points = np.random.default_rng(2).uniform(-0.7, 0.7, (500, 3)) * [1, 1, 0] + [0, 0, 1]
    k, none = np.array(lens.coefficients), np.zeros(3)
    if lens.model == "radtan":
        expected = cv2.projectPoints(points, none, none, CAMERA.K, k)[0].reshape(-1, 2)
    else:
        expected = cv2.fisheye.projectPoints(points.reshape(-1, 1, 3), none, none, CAMERA.K, k)[0].reshape(
            -1, 2
        )
    x, y = lens.distort(points[:, 0], points[:, 1])
    found = np.stack([CAMERA.fx_px * x + CAMERA.cx_px, CAMERA.fy_px * y + CAMERA.cy_px], -1)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.fixture(scope="module")
def tiles() -> Iterator[SceneRenderer]:
    """A wall of coloured squares across the view, 4 m ahead."""
    need_opengl()
    colours = np.random.default_rng(1)
    walls = []
    for y in np.arange(-12, 12, 0.8):
        for z in np.arange(-8, 8, 0.8):
            corners = [[4, y + 0.8, z], [4, y, z], [4, y, z + 0.8], [4, y + 0.8, z + 0.8]]
            colour = colours.integers(40, 255, 3)
            tag = Tag.WALL if colours.random() < 0.5 else Tag.BUILDING
            walls.append(
                make_mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material.PLASTER, tag=tag, colour=colour)
            )
    with SceneRenderer(walls, ModelLibrary({}), quality="low", albedo=plain_albedo()) as renderer:
        yield renderer


def frame_through(renderer: SceneRenderer, lens: Lens) -> Frame:
    optics = Optics(CAMERA, lens)
    T = Mount(position_m=(0.0, 0.3, 0.1), axes="optical").T_base_sensor
    return Frame(renderer.draw(optics.drawn, T, Instances()), renderer, optics.view)


@LENSES
def test_picture_undistorted_with_the_written_file_is_the_pinholes(
    tiles: SceneRenderer, lens: Lens, tmp_path: Path
) -> None:
    """The whole way: rig, Kalibr's file, OpenCV's rectification, comparison."""
    cameras = tuple(
        CameraConfig(name=name, mount=Mount(position_m=(0, y, 0), axes="optical"), pinhole=CAMERA, lens=lens)
        for name, y in (("left", 0.2), ("right", -0.2))
    )
    imu = rig_by_name("state").of_kind("imu")
    write_calibration(tmp_path, RigCalibration.from_configs([*cameras, *imu]))
    camera = yaml.safe_load((tmp_path / "kalibr/camchain-imucam.yaml").read_text())["cam0"]
    assert camera["distortion_model"] == lens.model
    fx, fy, cx, cy = camera["intrinsics"]
    K, k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(camera["distortion_coeffs"])
    size = tuple(camera["resolution"])
    if lens.model == "radtan":
        maps = cv2.initUndistortRectifyMap(K, k, np.eye(3), K, size, cv2.CV_32FC1)
    else:
        maps = cv2.fisheye.initUndistortRectifyMap(K, k, np.eye(3), K, size, cv2.CV_32FC1)
    weather = PRESETS["ClearNoon"]
    bent, plain = frame_through(tiles, lens), frame_through(tiles, Lens())
    seen = cv2.remap(bent.rgbs([weather], 0, 0)[0], *maps, cv2.INTER_LINEAR).astype(float)
    expected = plain.rgbs([weather], 0, 0)[0].astype(float)
    inside = (maps[0] > 1) & (maps[0] < size[0] - 2) & (maps[1] > 1) & (maps[1] < size[1] - 2)
    assert inside.mean() > 0.6
    # Away from the squares' edges, which interpolating twice makes softer.
    edges = cv2.dilate(cv2.Canny(expected.astype(np.uint8), 10, 20), np.ones((5, 5), np.uint8)) > 0
    flat = inside & ~edges
    assert flat.mean() > 0.2
    assert np.abs(seen - expected)[flat].max() <= 3.0
    assert np.abs(bent.rgbs([weather], 0, 0)[0].astype(float) - expected)[flat].mean() > 5.0


@LENSES
def test_depth_and_labels_are_those_of_each_pixels_own_ray(tiles: SceneRenderer, lens: Lens) -> None:
    bent = frame_through(tiles, lens)
    depth, (tag, _) = bent.depth_m, bent.labels
    np.testing.assert_allclose(depth, 4.0, atol=1e-3)
    assert set(np.unique(tag)) == {Tag.WALL, Tag.BUILDING}
    # Planar depth: the same wherever a pixel looks.
    assert depth.shape == (CAMERA.height_px, CAMERA.width_px)


@LENSES
def test_other_programs_get_the_same_numbers(lens: Lens, tmp_path: Path) -> None:
    cameras = tuple(
        CameraConfig(name=name, mount=Mount(position_m=(0, y, 0), axes="optical"), lens=lens)
        for name, y in (("left", 0.2), ("right", -0.2))
    )
    write_calibration(tmp_path, RigCalibration.from_configs(cameras))
    orb = cv2.FileStorage(str(tmp_path / "orbslam3_stereo.yaml"), cv2.FILE_STORAGE_READ)
    vins = cv2.FileStorage(str(tmp_path / "vins_fusion/cam0.yaml"), cv2.FILE_STORAGE_READ)
    if lens.model == "radtan":
        orb_names, node = ("k1", "k2", "p1", "p2"), "distortion_parameters"
        vins_names = orb_names
        assert orb.getNode("Camera.type").string() == "PinHole"
        assert vins.getNode("model_type").string() == "PINHOLE"
    else:
        orb_names, node = ("k1", "k2", "k3", "k4"), "projection_parameters"
        vins_names = ("k2", "k3", "k4", "k5")
        assert orb.getNode("Camera.type").string() == "KannalaBrandt8"
        assert vins.getNode("model_type").string() == "KANNALA_BRANDT"
        assert vins.getNode(node).getNode("mu").real() == 640.0
    assert tuple(orb.getNode(f"Camera1.{name}").real() for name in orb_names) == lens.coefficients
    assert tuple(vins.getNode(node).getNode(name).real() for name in vins_names) == lens.coefficients


def test_impossible_lenses_are_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean 'radtan'"):
        Lens(model="radtann")
    with pytest.raises(ConfigError, match="folds"):
        Lens(model="radtan", coefficients=(-0.9, 0.0, 0.0, 0.0)).rays(CAMERA)
