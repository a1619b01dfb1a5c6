"""A sequence as a recording: clouds, the map they make, images, the true path, estimates and their errors."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.cells import first_in_cells
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import quat_rotate
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.layout import whole_path
from recorder.dataset.scans import Scan
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.path_errors import PathErrors
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.report.lane_lines import lane_lines_of
from recorder.view.recording import (
    BASE_LINK,
    WORLD,
    Recording,
    new_recording,
)
from recorder.view.sky import COLOURS as SKY_COLOURS
from recorder.view.sky import read_sky
from recorder.view.town_recording import log_lanes

PERIOD_S = 0.2
"""Time between two clouds, and between two images, that are shown [s]."""
MAP_CELL_M = 0.4
"""Edge of the cubes of which the map keeps one point each [m]."""
IMAGE_WIDTH_PX, JPEG_QUALITY = 640, 80
"""Width of images and their quality; a recording is for looking, the dataset for computing."""
TRUTH, COLOURS = (
    (250, 250, 250),
    ((86, 180, 233), (230, 159, 0), (0, 158, 115), (213, 94, 0), (204, 121, 167), (240, 228, 66)),
)
"""Colours of the truth, and of estimates: Okabe and Ito's, which colour-blind people can tell apart."""


def record_sequence(
    sequence: SlamSequence,
    path: Path,
    *,
    estimates: Sequence[PathErrors] = (),
    period_s: float = PERIOD_S,
    overwrite: bool = False,
) -> Path:
    """Write a sequence as a recording.

    Args:
        sequence: The sequence; clouds, images and the sky of raw GNSS are left out where it has none.
        path: New file (.rrd).
        estimates: Estimates behind their fit, with their errors.
        period_s: Time between two clouds or images that are shown [s].
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the file may not be written.
        EvaluationError: the truth cannot be read, or a bag or image is damaged.
        MissingDependencyError: rerun is not installed.
    """
    town = whole_path(sequence.folder).parent.name
    with new_recording(path, f"{town} {sequence.name}", overwrite=overwrite) as recording:
        log_lanes(recording, lane_lines_of(town))
        truth = read_tum(sequence.truth_file("base_link"))
        recording.motion(BASE_LINK, truth.stamp_ns, truth.position_m, truth.quat_xyzw)
        recording.path(f"{WORLD}/truth", truth.position_m[::10], TRUTH, 0.12)
        for frame, T_base_sensor in sequence.rig.frames.items():
            recording.mount(f"{BASE_LINK}/{frame}", T_base_sensor)
        if sequence.rig.of_kind("lidar"):
            _log_clouds(recording, sequence, period_s)
        has_images = _log_images(recording, sequence, period_s)
        _log_estimates(recording, estimates)
        blueprint = recording.rerun.blueprint
        views = [recording.world_view(truth.position_m[0], truth.quat_xyzw[0])]
        if has_images:
            camera = f"{BASE_LINK}/{sequence.stereo[0].frame_id}/image"
            views.append(blueprint.Spatial2DView(origin=camera, name="left camera"))
        if _log_sky(recording, sequence):
            views.append(blueprint.Spatial2DView(origin="sky", name="satellites, north up"))
        if estimates:
            views.append(blueprint.TimeSeriesView(origin="error_m", name="position error [m]"))
        recording.show(*views)
    return path


def _log_clouds(recording: Recording, sequence: SlamSequence, period_s: float) -> None:
    """Sweeps as measured, and as a map, each point from where the LiDAR was at its own time."""
    lidar = sequence.lidar
    truth = read_tum(sequence.truth_file("lidar"))
    positions, tags = [], []
    for scan in every(sequence.scans(), period_s):
        colour = (
            {"class_ids": scan.tag}
            if scan.tag is not None
            else {"colors": np.repeat(greys(scan, 60)[:, None], 3, axis=1)}
        )
        points = recording.rerun.Points3D(scan.points_xyz_m.astype(np.float32), radii=[0.03], **colour)
        recording.at(scan.stamp_ns, f"{BASE_LINK}/{lidar.frame_id}/points", points)
        world_m = in_world(scan, truth)
        kept = first_in_cells(world_m, MAP_CELL_M)
        positions.append(world_m[kept])
        tags.append(np.zeros(len(kept), np.uint8) if scan.tag is None else scan.tag[kept])
    if not positions:
        return
    map_m, tag = np.concatenate(positions), np.concatenate(tags)
    kept = first_in_cells(map_m, MAP_CELL_M)
    looks = {"class_ids": tag[kept]} if tag.any() else {"colors": [(150, 150, 160)]}
    recording.always(
        f"{WORLD}/map", recording.rerun.Points3D(map_m[kept].astype(np.float32), radii=[0.04], **looks)
    )


def in_world(scan: Scan, truth: Trajectory) -> Array:
    """Points of a sweep in the world [m], each from where the LiDAR was at its own time, (N, 3)."""
    stamp_ns, row = np.unique(
        scan.stamp_ns + np.rint(scan.time_s * 1e9).astype(np.int64), return_inverse=True
    )
    at = truth.at(stamp_ns)
    world_m: Array = at.position_m[row] + quat_rotate(at.quat_xyzw[row], scan.points_xyz_m)
    return world_m


def every(scans: Iterator[Scan], period_s: float) -> Iterator[Scan]:
    """Scans that lie a period or more apart."""
    following_ns = 0
    for scan in scans:
        if scan.stamp_ns >= following_ns:
            following_ns = scan.stamp_ns + round(period_s * 1e9)
            yield scan


def greys(scan: Scan, darkest: int) -> U8:
    """Greys from the darkest one to 255 by the intensity of the echoes, (N,)."""
    intensity = np.ones(len(scan.time_s)) if scan.intensity is None else scan.intensity
    return (darkest + (255 - darkest) * np.clip(intensity, 0.0, 1.0)).astype(np.uint8)


def _log_images(recording: Recording, sequence: SlamSequence, period_s: float) -> bool:
    """Images of the left camera, smaller; whether there are some."""
    try:
        camera, stamps_ns = sequence.stereo[0], sequence.image_stamps()
    except EvaluationError:
        return False
    entity = f"{BASE_LINK}/{camera.frame_id}"
    _log_lens(recording, camera, entity)
    step = max(round(period_s * camera.rate_hz), 1)
    for stamp_ns in stamps_ns[::step].tolist():
        file = sequence.euroc / "cam0" / "data" / f"{stamp_ns}.png"
        picture = cv2.imread(str(file))
        if picture is None:
            raise EvaluationError(f"{file} is no image; replay it anew")
        jpeg = recording.rerun.EncodedImage(contents=jpeg_of(picture), media_type="image/jpeg")
        recording.at(stamp_ns, f"{entity}/image", jpeg)
    return bool(len(stamps_ns))


def _log_sky(recording: Recording, sequence: SlamSequence) -> bool:
    """Satellites over time, by the colours of their ways; whether there are some."""
    sky = read_sky(sequence)
    if sky is None:
        return False
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    circles = recording.rerun.LineStrips2D(
        [radius * circle for radius in (30, 60, 90)], colors=[(90, 90, 90)]
    )
    recording.always("sky/circles", circles)
    places, colours = sky.place * [1.0, -1.0], np.array(SKY_COLOURS, np.uint8)[sky.way]
    for stamp_ns, begin, end in zip(sky.stamp_ns.tolist(), sky.first[:-1], sky.first[1:], strict=True):
        looks = {"colors": colours[begin:end], "labels": sky.name[begin:end].tolist(), "radii": [2.0]}
        recording.at(stamp_ns, "sky/satellites", recording.rerun.Points2D(places[begin:end], **looks))
    return True


def _log_lens(recording: Recording, camera: CameraConfig, entity: str) -> None:
    eye = camera.pinhole
    scale = IMAGE_WIDTH_PX / eye.width_px
    pinhole = recording.rerun.Pinhole(
        focal_length=[scale * eye.fx_px, scale * eye.fy_px],
        principal_point=[scale * (eye.cx_px + 0.5), scale * (eye.cy_px + 0.5)],
        resolution=[IMAGE_WIDTH_PX, round(scale * eye.height_px)],
        image_plane_distance=2.0,
    )
    recording.always(f"{entity}/image", pinhole)


def jpeg_of(picture: object, width_px: int = IMAGE_WIDTH_PX, quality: int = JPEG_QUALITY) -> bytes:
    """A picture (BGR or grey) as JPEG of a width."""
    image = np.asarray(picture, np.uint8)
    size = (width_px, round(width_px * image.shape[0] / image.shape[1]))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def _log_estimates(recording: Recording, estimates: Sequence[PathErrors]) -> None:
    """Paths as they lie after the fit, and their position errors over time."""
    for k, estimate in enumerate(estimates):
        name, colour = estimate.name or f"estimate {k + 1}", COLOURS[k % len(COLOURS)]
        entity = _entity(name)
        recording.path(f"{WORLD}/estimates/{entity}", estimate.estimate_m, colour, 0.1)
        looks = recording.rerun.SeriesLines(colors=[colour], names=[name])
        recording.always(f"error_m/{entity}", looks)
        scalars = recording.rerun.Scalars.columns(scalars=estimate.error_m)
        recording.columns(f"error_m/{entity}", estimate.stamp_ns, scalars)


def _entity(name: str) -> str:
    """Part of an entity's path that stands for a name."""
    return "".join(sign if sign.isalnum() or sign in "_-" else "_" for sign in name)
