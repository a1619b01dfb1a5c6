"""OPV2V's layout, which OpenCOOD reads: a folder for each agent, with a cloud, pictures and a table a frame.

Layout: OpenCOOD's ``docs/md_files/data_intro.md`` and ``data_annotation_tutorial.md``. Frames are CARLA's:
x ahead, y to the right, z up; poses are x, y, z [m], roll (left side up), yaw (clockwise), pitch (nose up)
[deg]. A sweep is one instant there: points lie where they would have been at its stamp.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.ego import EGO_CENTRE_M
from carlaloc_env.core.elementary import arctan2
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.base import Piece, png_of
from recorder.writers.formats.nuscenes import NuscenesEncoder, PerceptionWriter
from recorder.writers.formats.nuscenes_boxes import SLACK_M, Boxes, points_in
from recorder.writers.formats.nuscenes_tables import Channel
from recorder.writers.formats.pcd import pcd_bytes
from recorder.writers.rig_calibration import RigCalibration

if TYPE_CHECKING:
    from recorder.writers.formats.town_ground import TownGround

FRAME_NS = 2 * STEP_NS
"""Time between frames [ns]; their numbers count steps of 50 ms, as those of OPV2V do."""
PROTOCOL = "data_protocol.yaml"
"""File of a scenario that describes how it was made."""
_DIRECTIONS = ("CAM_FRONT", "CAM_BACK_RIGHT", "CAM_BACK_LEFT", "CAM_BACK")
CAMERAS = {name: f"camera{number}" for number, name in enumerate(_DIRECTIONS)}
"""Names of the cameras by the direction in which they look."""
VEHICLES = (Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.MOTORCYCLE, Tag.BICYCLE)
"""Road users with boxes."""
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_CAMERA_AXES = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], np.float64)
"""Maps axes ahead, left, up to the optical ones: right, down, ahead."""


def carla_pose(T_world_frame: Array) -> list[float]:
    """Pose in CARLA's axes: x, y, z [m], roll, yaw, pitch [deg], of a pose in ours, shape (4, 4)."""
    T = carla_transform(T_world_frame)
    level = np.sqrt(T[0, 0] ** 2 + T[1, 0] ** 2)
    angles = arctan2(-T[2, 1], T[2, 2]), arctan2(T[1, 0], T[0, 0]), arctan2(T[2, 0], level)
    return [round(float(value), 6) for value in (*T[:3, 3], *np.degrees(angles))]


def carla_transform(T: Array) -> Array:
    """A transform between frames with y to the left, as one between frames with y to the right, (4, 4)."""
    mirrored: Array = _MIRROR @ T @ _MIRROR
    return mirrored


class Opv2vEncoder(NuscenesEncoder):
    """Pictures as PNG, clouds, poses and road users of an agent.

    Args:
        calibration: The rig; it must have a LiDAR.
        streams: Names of all streams that will come.

    Raises:
        WriterError: the rig has no LiDAR.
    """

    def __init__(self, calibration: RigCalibration, streams: tuple[str, ...]) -> None:
        super().__init__(calibration, streams)
        kept = ("LIDAR_TOP", *CAMERAS)
        self.channels = {s: channel for s, channel in self.channels.items() if channel.name in kept}

    def _packed(self, rgb: U8, name: str) -> bytes:
        return png_of(rgb[:, :, ::-1], name)


class Opv2vWriter(PerceptionWriter):
    """A scenario with one agent: ``<scenario>/<agent>/00000.{pcd,yaml}``, ``00000_camera0.png`` … at 10 Hz.

    Args:
        target: The folder.
        encoder: Makes the pieces.
        ground: Gives the town.
        agent: Number of the car as an object of others; negative for a fixed unit.
        about: Texts of the sequence: ``name``, ``town``, ``weather``, ``traffic``, ``rig``.
    """

    def __init__(
        self,
        target: str | Path,
        encoder: Opv2vEncoder,
        *,
        ground: Callable[[], TownGround],
        agent: int,
        about: Mapping[str, str],
    ) -> None:
        super().__init__(target, encoder, ground=ground, about=about)
        self._agent = agent
        ahead_m = EGO_CENTRE_M if agent >= 0 else 0.0
        self._T_base_middle = transforms.from_rotation(np.eye(3), (ahead_m, 0.0, 0.0))
        self._frame = -1
        self._table: dict[str, Any] = {}

    def _begin(self, part: Path) -> None:
        scenario = part / scenario_of(self._about)
        self._folder = scenario / str(self._agent)
        self._folder.mkdir(parents=True)
        world = {"town": self._about.get("town", ""), "fixed_delta_seconds": STEP_NS * 1e-9}
        about = {name: text for name, text in self._about.items() if name not in ("name", "town")}
        text = yaml.safe_dump({"world": world, "carlaloc": about}, sort_keys=False)
        (scenario / PROTOCOL).write_text(text, encoding="utf-8")
        self._ground = self._load_ground()

    def _put(self, piece: Piece) -> None:
        channel, frame = self._channels[piece.place], piece.stamp_ns // FRAME_NS
        if frame != self._frame:
            self._put_table()
            self._frame, self._table = frame, {}
        name = CAMERAS.get(channel.name, "lidar")
        # A frame holds the first sweep and the first pictures of its 100 ms.
        if name in self._table:
            return
        self._path.forget_before(piece.stamp_ns - STEP_NS)
        T_world_base = self._path.T_world_base(piece.stamp_ns)
        if channel.modality == "camera":
            (self._folder / f"{self._number}_{name}.png").write_bytes(piece.data)
            T = T_world_base @ channel.T_ego_sensor @ _CAMERA_AXES
            self._table[name] = {"T": T, "intrinsic": np.asarray(channel.K).tolist()}
        else:
            self._put_sweep(piece, channel, T_world_base)

    @property
    def _number(self) -> str:
        return f"{self._frame * (FRAME_NS // STEP_NS):05d}"

    def _put_sweep(self, piece: Piece, lidar: Channel, T_world_base: Array) -> None:
        rows, world = self._at_stamp(piece, lidar)
        T_world_lidar = T_world_base @ lidar.T_ego_sensor
        points = transforms.apply(_MIRROR @ transforms.invert(T_world_lidar), world)
        (self._folder / f"{self._number}.pcd").write_bytes(pcd(points, rows["intensity"]))
        boxes, eye_m = self._tracks.boxes(piece.stamp_ns, self._ground), T_world_lidar[:3, 3]
        later = self._path.T_world_base(piece.stamp_ns + STEP_NS)[:3, 3]
        place = carla_pose(T_world_base @ self._T_base_middle)
        self._table["lidar"] = {
            "T": T_world_lidar,
            "ego_speed": _kmh(float(np.linalg.norm(later - T_world_base[:3, 3])) / (STEP_NS * 1e-9)),
            "place": place,
            "vehicles": vehicles_of(boxes.near(eye_m), world, eye_m),
        }

    def _put_table(self) -> None:
        """The table of the frame that has ended; one without a sweep leaves nothing."""
        sweep = self._table.pop("lidar", None)
        if sweep is None:
            for name in self._table:
                (self._folder / f"{self._number}_{name}.png").unlink()
            return
        table: dict[str, Any] = {}
        for name, camera in sorted(self._table.items()):
            extrinsic = carla_transform(transforms.invert(camera["T"]) @ sweep["T"])
            table[name] = {
                "cords": carla_pose(camera["T"]),
                "extrinsic": np.round(extrinsic, 9).tolist(),
                "intrinsic": camera["intrinsic"],
            }
        table |= {
            "ego_speed": sweep["ego_speed"],
            "lidar_pose": carla_pose(sweep["T"]),
            "predicted_ego_pos": sweep["place"],
            "true_ego_pos": list(sweep["place"]),
            "vehicles": sweep["vehicles"],
        }
        text = yaml.dump(table, Dumper=_DUMPER, sort_keys=False)
        (self._folder / f"{self._number}.yaml").write_text(text, encoding="utf-8")

    def _finish(self) -> None:
        self._put_last()
        self._put_table()
        self._check_sweeps(any(self._folder.glob("*.pcd")))


def scenario_of(about: Mapping[str, str]) -> str:
    """Name of the scenario: town, weather and traffic."""
    return f"{about.get('town', 'town')}_{about.get('name', 'sequence')}"


def vehicles_of(boxes: Boxes, world_m: Array, eye_m: Array) -> dict[int, dict[str, Any]]:
    """Vehicles with a point of the LiDAR in their box, by their number.

    OpenCOOD adds `center` to `location` without turning it: both together are the middle of the box.
    """
    hits, _ = points_in(boxes, world_m, eye_m)
    found: dict[int, dict[str, Any]] = {}
    for k in np.flatnonzero((hits > 0) & np.isin(boxes.tag, VEHICLES)).tolist():
        x, y, z, *angle = carla_pose(transforms.transform(boxes.centre_m[k], boxes.quat_xyzw[k]))
        extent = [round(float(size), 4) for size in 0.5 * boxes.size_m[k] - SLACK_M]
        found[int(boxes.id[k])] = {
            "angle": angle,
            "center": [0.0, 0.0, extent[2]],
            "extent": extent,
            "location": [x, y, round(z - extent[2], 6)],
            "speed": _kmh(float(boxes.speed_mps[k])),
        }
    return found


def pcd(points_m: Array, intensity: NDArray[np.float32]) -> bytes:
    """Points (N, 3) [m] as a binary PCD whose colour's red channel is the intensity (N,), 0–255."""
    grey = np.clip(np.rint(intensity), 0, 255).astype(np.uint32)
    columns = (*points_m.astype("<f4").T, grey << 16 | grey << 8 | grey)
    return pcd_bytes(np.rec.fromarrays(columns, [*((axis, "<f4") for axis in "xyz"), ("rgb", "<u4")]))


def _kmh(speed_mps: float) -> float:
    return round(3.6 * speed_mps, 4)
