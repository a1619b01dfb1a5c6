"""nuScenes' layout: samples twice a second with boxes, sweeps between them, tables, and a mask of the map.

The points of a sweep, and those of road users with their road user, lie where they would have been at the
sweep's stamp, so that points, boxes and images of a sample agree. The global frame is the world, moved by
whole metres so that the town's coordinates are positive, as the map's mask needs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, ObjectList, PointCloud, RadarScan, Sample
from recorder.writers.base import Encoder, Piece, jpeg_of, png_of
from recorder.writers.formats.ego_path import FollowingWriter, is_pose, pose_piece
from recorder.writers.formats.nuscenes_boxes import OBJECTS, ActorTracks, Boxes, objects_piece, points_in
from recorder.writers.formats.nuscenes_tables import (
    BOX_CATEGORY,
    MOVING_FROM_MPS,
    VERSION,
    Channel,
    Row,
    SequenceTables,
    lidarseg_table,
    place_of,
    write_table,
)
from recorder.writers.formats.pcd import pcd_bytes
from recorder.writers.formats.sweep_points import POINT, at_stamp, point_rows
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration

if TYPE_CHECKING:
    from recorder.writers.formats.town_ground import TownGround

SAMPLE_NS, SCENE_NS = 500_000_000, 20_000_000_000
"""Time between samples, and length of a scene [ns]."""
JPEG_QUALITY = 95
"""Quality of images."""
_SECTORS = ("FRONT", "FRONT_LEFT", "BACK_LEFT", "BACK", "BACK_RIGHT", "FRONT_RIGHT")
"""Directions of sensors, by sixths of a turn to the left."""
_RADAR = np.dtype(
    [(name, "<f4") for name in "xyz"]
    + [("dyn_prop", "i1"), ("id", "<i2")]
    + [(name, "<f4") for name in ("rcs", "vx", "vy", "vx_comp", "vy_comp")]
    + [(name, "i1") for name in ("is_quality_valid", "ambig_state", "x_rms", "y_rms", "invalid_state",
                                 "pdh0", "vx_rms", "vy_rms")]
)  # fmt: skip


def channels_of(calibration: RigCalibration, streams: tuple[str, ...]) -> dict[str, Channel]:
    """Channels by stream, LiDAR first; of sensors that look the same way, the first has nuScenes' name.

    Raises:
        WriterError: the rig has no LiDAR.
    """
    lidar = calibration.lidar
    if lidar is None:
        raise WriterError("the nuScenes format needs a LiDAR; add one to the rig")
    stream = f"{lidar.name}_semantic" if f"{lidar.name}_semantic" in streams else lidar.name
    channels = {stream: Channel(name="LIDAR_TOP", modality="lidar", T_ego_sensor=lidar.T_base_lidar)}
    taken = {"LIDAR_TOP"}

    def name_of(kind: str, ahead: Array, own: str) -> str:
        sector = round(float(np.degrees(np.arctan2(ahead[1], ahead[0]))) / 60.0) % 6
        name = f"{kind}_{_SECTORS[sector]}"
        if name in taken:
            name = f"{kind}_{own.upper()}"
        taken.add(name)
        return name

    for camera in calibration.cameras:
        T = camera.T_base_camera
        size = (camera.pinhole.height_px, camera.pinhole.width_px)
        name = name_of("CAM", T[:3, 2], camera.name)
        channels[camera.stream] = Channel(
            name=name, modality="camera", T_ego_sensor=T, K=camera.pinhole.K, size_px=size
        )
    for stream in streams:
        if stream.startswith("radar_") and stream in calibration.frames:
            T = calibration.frames[stream]
            name = name_of("RADAR", T[:3, 0], stream.removeprefix("radar_"))
            channels[stream] = Channel(name=name, modality="radar", T_ego_sensor=T)
    return channels


class NuscenesEncoder(Encoder):
    """Images, clouds, detections, poses and road users of a nuScenes folder.

    Args:
        calibration: The rig; it must have a LiDAR.
        streams: Names of all streams that will come.

    Raises:
        WriterError: the rig has no LiDAR.
    """

    def __init__(self, calibration: RigCalibration, streams: tuple[str, ...]) -> None:
        self.channels = channels_of(calibration, streams)
        self._cameras = {camera.stream: camera for camera in calibration.cameras}
        self._maps: dict[str, tuple[NDArray[np.float32], NDArray[np.float32]]] = {}

    def encode(self, sample: Sample) -> list[Piece]:
        """Images as JPEG without distortion; all else as rows of numbers, to be put together in order."""
        if isinstance(sample, ObjectList):
            return [objects_piece(sample)]
        if is_pose(sample):
            return [pose_piece(sample)]
        if sample.sensor not in self.channels:
            return []
        place = self.channels[sample.sensor].name
        if isinstance(sample, PointCloud):
            return [Piece(sample.stamp_ns, place, str(sample.sweep_ns), point_rows(sample))]
        if isinstance(sample, RadarScan):
            return [Piece(sample.stamp_ns, place, str(TICK_NS), _radar_rows(sample))]
        if isinstance(sample, Image):
            rgb = self._undistorted(sample.rgb, self._cameras[sample.sensor])
            return [Piece(sample.stamp_ns, place, "", self._packed(rgb, sample.sensor))]
        return []

    def _packed(self, rgb: U8, name: str) -> bytes:
        """An image as its file."""
        return jpeg_of(rgb, name, JPEG_QUALITY)

    def _undistorted(self, rgb: U8, camera: CameraCalibration) -> U8:
        """The image as the pinhole alone would see it; black where the lens sees nothing of it."""
        if camera.lens.is_plain:
            return rgb
        if camera.name not in self._maps:
            self._maps[camera.name] = camera.lens.undistortion_px(camera.pinhole, camera.pinhole)
        return np.asarray(cv2.remap(rgb, *self._maps[camera.name], cv2.INTER_LINEAR), np.uint8)


def _radar_rows(sample: RadarScan) -> bytes:
    """Detections; the speed along the ray stands in ``vx`` and ``vy`` until the car's is known."""
    rows = np.zeros(len(sample.range_m), _RADAR)
    points = sample.points_xyz_m
    rows["x"], rows["y"], rows["z"] = points.T
    rows["rcs"], rows["id"] = sample.rcs_dbsm, np.arange(len(rows))
    ray = points / np.maximum(sample.range_m, 1e-6)[:, None]
    rows["vx"], rows["vy"] = (sample.doppler_mps * ray[:, k] for k in range(2))
    # nuScenes' devkit drops detections in other states.
    rows["ambig_state"], rows["is_quality_valid"] = 3, 1
    return rows.tobytes()


class PerceptionWriter(FollowingWriter):
    """A writer of the pieces of `NuscenesEncoder`, which moves points and road users to the sweeps' stamps.

    Args:
        target: The folder.
        encoder: Makes the pieces.
        ground: Gives the town.
        about: Texts of the sequence.
    """

    encoder: NuscenesEncoder

    def __init__(
        self,
        target: str | Path,
        encoder: NuscenesEncoder,
        *,
        ground: Callable[[], TownGround],
        about: Mapping[str, str],
    ) -> None:
        super().__init__(target, encoder)
        self._load_ground, self._about = ground, about
        self._channels = {channel.name: channel for channel in encoder.channels.values()}
        self._tracks = ActorTracks()

    def _place(self, piece: Piece) -> None:
        if piece.place == OBJECTS:
            self._tracks.add(piece)
        else:
            super()._place(piece)

    def _at_stamp(self, piece: Piece, lidar: Channel) -> tuple[NDArray[np.void], Array]:
        """Points of a sweep as rows of `POINT`, and where they lie in the world at its stamp [m], (N, 3)."""
        rows = np.frombuffer(piece.data, POINT)
        self._tracks.forget_before(piece.stamp_ns - STEP_NS)
        return rows, at_stamp(piece, rows, self._path, self._tracks, lidar.T_ego_sensor)

    @staticmethod
    def _check_sweeps(found: bool) -> None:
        if not found:
            raise OSError("the stretch holds no whole sweep of the LiDAR; make it longer")


class NuscenesWriter(PerceptionWriter):
    """Samples, sweeps, boxes, labels, map and tables; a sample is a sweep of the LiDAR.

    Of the texts, tables hold ``name`` and ``weather``.
    """

    def _begin(self, part: Path) -> None:
        self._first_ns: int | None = None
        self._next_ns = 0
        self._seen: dict[str, Array] = {}
        for channel in self._channels.values():
            for folder in ("samples", "sweeps"):
                (part / folder / channel.name).mkdir(parents=True)
        for folder in (VERSION, f"lidarseg/{VERSION}", "maps"):
            (part / folder).mkdir(parents=True)
        self._ground = self._load_ground()
        self._origin = np.array([*self._ground.origin_m, 0.0])
        day = datetime.fromtimestamp(self.encoder.epoch_ns // 1_000_000_000, timezone.utc)
        self._tables = SequenceTables(
            name=f"{self._ground.name}/{self._about.get('name', 'sequence')}",
            town=self._ground.name,
            origin_m=self._ground.origin_m,
            about=self._about.get("name", ""),
            date=day.date().isoformat(),
        )
        png = png_of(self._ground.mask, "the map")
        (part / "maps" / f"{self._ground.name}.png").write_bytes(png)

    def _put(self, piece: Piece) -> None:
        channel, stamp_ns = self._channels[piece.place], piece.stamp_ns
        us = self.encoder.unix_ns(stamp_ns) // 1000
        self._path.forget_before(stamp_ns - STEP_NS)
        T_world_base = self._path.T_world_base(stamp_ns)
        self._tables.poses.setdefault(us, self._global(T_world_base))
        self._tables.data_us[channel.name].append(us)
        data = piece.data
        if channel.modality == "lidar":
            data = self._put_cloud(piece, channel, T_world_base, us)
        elif channel.modality == "radar":
            data = self._detections(piece, channel, T_world_base)
        (self._part / self._tables.file_name(channel, us, False)).write_bytes(data)

    def _global(self, T_world_frame: Array) -> Row:
        moved = T_world_frame.copy()
        moved[:3, 3] -= self._origin
        return place_of(moved)

    def _put_cloud(self, piece: Piece, lidar: Channel, T_world_base: Array, us: int) -> bytes:
        """Points at the sweep's stamp; the boxes and labels of a sample."""
        (rows, world), stamp_ns = self._at_stamp(piece, lidar), piece.stamp_ns
        T_world_lidar = T_world_base @ lidar.T_ego_sensor
        points = np.empty((len(rows), 5), "<f4")
        points[:, :3] = transforms.apply(transforms.invert(T_world_lidar), world)
        points[:, 3], points[:, 4] = rows["intensity"], rows["ring"]
        if self._first_ns is None:
            self._first_ns = self._next_ns = stamp_ns
        if stamp_ns >= self._next_ns:
            self._next_ns = stamp_ns + SAMPLE_NS - (stamp_ns - self._first_ns) % SAMPLE_NS
            self._tables.samples_us.append(us)
            self._tables.scenes.append((stamp_ns - self._first_ns) // SCENE_NS)
            eye_m = T_world_lidar[:3, 3]
            boxes = self._tracks.boxes(stamp_ns, self._ground).near(eye_m)
            self._tables.boxes.append(self._boxes(boxes, world, eye_m))
            labels = lidarseg_table()[rows["tag"]]
            (self._part / self._tables.lidarseg_name(lidar, us)).write_bytes(labels.tobytes())
        return points.tobytes()

    def _boxes(self, boxes: Boxes, world_m: Array, eye_m: Array) -> list[Row]:
        """Boxes with points of the LiDAR, or of the radars' last scans, in them."""
        hits, seen = points_in(boxes, world_m, eye_m)
        detections = np.zeros(len(hits), np.int64)
        for points in self._seen.values():
            detections += points_in(boxes, points, eye_m)[0]
        visible = np.where(np.isnan(boxes.visible), seen, boxes.visible)
        rows: list[Row] = []
        for k in np.flatnonzero(hits + detections).tolist():
            if int(boxes.tag[k]) not in BOX_CATEGORY:
                continue
            length, width, height = boxes.size_m[k].tolist()
            T = transforms.transform(boxes.centre_m[k], boxes.quat_xyzw[k])
            rows.append(
                {
                    "number": int(boxes.id[k]), "category": BOX_CATEGORY[int(boxes.tag[k])],
                    "place": self._global(T), "size": [width, length, height],
                    "speed_mps": float(boxes.speed_mps[k]), "visible": float(visible[k]),
                    "points": int(hits[k]), "detections": int(detections[k]),
                }
            )  # fmt: skip
        return rows

    def _detections(self, piece: Piece, radar: Channel, T_world_base: Array) -> bytes:
        """A radar's points with their speeds over the ground, as PCD."""
        rows = np.frombuffer(piece.data, _RADAR).copy()
        points = np.stack([rows[name] for name in "xyz"], axis=-1).astype(np.float64)
        T_world_radar = T_world_base @ radar.T_ego_sensor
        self._seen[radar.name] = transforms.apply(T_world_radar, points)
        later = self._path.T_world_base(piece.stamp_ns + TICK_NS) @ radar.T_ego_sensor
        velocity = (later[:3, 3] - T_world_radar[:3, 3]) / (TICK_NS * 1e-9)
        ray = points / np.maximum(np.sqrt(np.sum(points**2, axis=1)), 1e-6)[:, None]
        R_radar_world = transforms.from_rotation(T_world_radar[:3, :3].T)
        own_mps = np.sum(ray * transforms.apply(R_radar_world, velocity), axis=1)
        rows["vx_comp"], rows["vy_comp"] = (rows[f"v{axis}"] + own_mps * ray[:, k]
                                            for k, axis in enumerate("xy"))  # fmt: skip
        still = np.hypot(rows["vx_comp"], rows["vy_comp"]) < MOVING_FROM_MPS
        rows["dyn_prop"] = np.where(still, 1, 0)
        return _pcd(rows)

    def _finish(self) -> None:
        self._put_last()
        self._check_sweeps(bool(self._tables.samples_us))
        for channel in self._channels.values():
            for row in self._tables.key_rows(channel.name):
                us = self._tables.data_us[channel.name][row]
                names = (self._tables.file_name(channel, us, is_key) for is_key in (False, True))
                before, after = (self._part / name for name in names)
                before.rename(after)
        channels = [c for c in self._channels.values() if self._tables.data_us[c.name]]
        for name, rows in self._tables.tables(channels):
            write_table(self._part / VERSION / f"{name}.json", rows)


def _pcd(rows: NDArray[np.void]) -> bytes:
    """Binary PCD of detections; a scan without any has one of NaN, which nuScenes' devkit takes for none."""
    if not len(rows):
        rows = np.zeros(1, _RADAR)
        for name in "xyz":
            rows[name] = np.nan
    # The devkit wants more bytes behind the last number.
    return pcd_bytes(rows) + b"\n"
