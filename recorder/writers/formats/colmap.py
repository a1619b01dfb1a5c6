"""COLMAP's text model and nerfstudio's ``transforms.json`` of the same pictures, for splats; poses are exact.

Axes and pixels are as in COLMAP's ``doc/format.rst`` and nerfstudio's ``data_conventions.md``: the middle of
the first pixel lies at 0.5.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.cells import first_in_cells
from carlaloc_env.samples import DepthImage, Image, PointCloud, Sample, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE
from recorder.writers.base import Encoder, Piece, png_of
from recorder.writers.formats.ego_path import FollowingWriter, is_pose, pose_piece
from recorder.writers.formats.ply import ply_bytes
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration

CLEAN_PLATE = "clean_plate"
"""Name of the twin without traffic."""
SEED_NS = 200_000_000
"""Time between sweeps that give seed points [ns]."""
CELL_M = 0.1
"""Edge of the cubes that keep one seed point each [m]."""
DEPTH_STEP_M = 1e-3
"""Step of depth files [m]; farther than 65.535 m is 0, unknown."""
_MODELS = {"none": "PINHOLE", "radtan": "OPENCV", "equidistant": "OPENCV_FISHEYE"}
_POINT = np.dtype([("xyz", "<f4", 3), ("offset_ns", "<u4"), ("tag", "u1")])
_SEED = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3), ("tag", "u1")])
_ROWS_MAX = 2_000_000
_IMAGES, _MASKS, _DEPTHS, _POINTS = "images", "masks", "depths", "points"
_GL: Array = np.diag([1.0, -1.0, -1.0, 1.0])
"""Maps OpenGL's axes of a camera (right, up, backward) to optical ones."""


class ColmapEncoder(Encoder):
    """Pictures, masks, depth, still points and poses.

    Args:
        calibration: The rig.
        streams: Names of all streams that will come.
    """

    def __init__(self, calibration: RigCalibration, streams: tuple[str, ...]) -> None:
        self.calibration = calibration
        lidar = calibration.lidar
        labelled = f"{lidar.name}_semantic" if lidar is not None else ""
        self._cloud = labelled if labelled in streams else lidar.name if lidar is not None else ""
        self._cameras = {camera.name for camera in calibration.cameras}

    def encode(self, sample: Sample) -> list[Piece]:
        """Pictures, masks and depth as PNG; still points and poses as rows of numbers."""
        if is_pose(sample):
            return [pose_piece(sample)]
        if isinstance(sample, PointCloud) and sample.sensor == self._cloud:
            rows = np.zeros(len(sample.ring), _POINT)
            rows["xyz"], rows["offset_ns"] = sample.points_xyz_m, sample.offset_ns
            if sample.tag is not None and sample.instance is not None:
                rows["tag"] = sample.tag
                rows = rows[sample.instance < EGO_INSTANCE]
            return [Piece(sample.stamp_ns, _POINTS, str(sample.sweep_ns), rows.tobytes())]
        kind, _, camera = sample.sensor.partition("_")
        if camera not in self._cameras:
            return []
        png: bytes | None = None
        if isinstance(sample, Image):
            kind, png = _IMAGES, png_of(cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2BGR), sample.sensor)
        elif isinstance(sample, SemanticImage):
            # Black hides road users and the ego's body.
            still = np.where(sample.instance < EGO_INSTANCE, np.uint8(255), np.uint8(0))
            kind, png = _MASKS, png_of(still, sample.sensor)
        elif isinstance(sample, DepthImage):
            steps = np.rint(sample.depth_m / DEPTH_STEP_M)
            near = np.where(steps <= 65535, steps, 0).astype(np.uint16)
            kind, png = _DEPTHS, png_of(near, sample.sensor)
        return [] if png is None else [Piece(sample.stamp_ns, f"{kind}/{camera}", "", png)]


@dataclass(frozen=True, slots=True)
class _View:
    """A picture."""

    camera: CameraCalibration
    stamp_ns: int
    T_world_camera: Array


class ColmapWriter(FollowingWriter):
    """Pictures, masks, depth, ``sparse/0``, ``transforms.json`` and seed points in a folder.

    Seed points are those of the LiDAR that a camera sees, with its colours; masks are black where road users
    and the ego's own body are. Of each picture the same view is named in the twins of its sequence: its clean
    plate, which has no traffic, and other weathers.

    Args:
        target: The folder.
        encoder: Makes the pieces.
        twins: Folders of the twin sequences by name, beside that of this one.
    """

    encoder: ColmapEncoder

    def __init__(
        self, target: str | Path, encoder: ColmapEncoder, *, twins: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(target, encoder)
        self._twins = twins or {}
        self._cameras = {camera.name: camera for camera in encoder.calibration.cameras}
        self._views: list[_View] = []
        self._written: set[str] = set()
        self._now: dict[str, bytes] = {}
        """Pictures of one instant by place, and the cloud that begins at it."""
        self._now_ns, self._next_ns = -1, 0
        self._seeds: list[NDArray[np.void]] = []

    def _begin(self, part: Path) -> None:
        (part / "sparse" / "0").mkdir(parents=True)

    def _put(self, piece: Piece) -> None:
        if piece.stamp_ns != self._now_ns:
            self._sow()
            self._now, self._now_ns = {}, piece.stamp_ns
            self._path.forget_before(piece.stamp_ns)
        self._now[piece.place] = piece.data
        if piece.place == _POINTS:
            return
        kind, name = piece.place.split("/", 1)
        path = self._file(kind, name, piece.stamp_ns)
        (self._part / path).parent.mkdir(exist_ok=True)
        (self._part / path).write_bytes(piece.data)
        self._written.add(path)
        if kind == _IMAGES:
            camera = self._cameras[name]
            T = self._path.T_world_base(piece.stamp_ns) @ camera.T_base_camera
            self._views.append(_View(camera, piece.stamp_ns, T))

    def _file(self, kind: str, camera: str, stamp_ns: int) -> str:
        """Path of a picture, whose name is unique without its folder; COLMAP finds a mask by that name."""
        name = f"{kind}/{camera}_{self.encoder.unix_ns(stamp_ns)}.png"
        return f"{name}.png" if kind == _MASKS else name

    def _sow(self) -> None:
        """Keep the points of the last instant's sweep that its pictures show, in their colours."""
        lidar = self.encoder.calibration.lidar
        stamp_ns, data = self._now_ns, self._now.get(_POINTS)
        if data is None or lidar is None or stamp_ns < self._next_ns:
            return
        self._next_ns = stamp_ns + SEED_NS
        rows = np.frombuffer(data, _POINT)
        seen_ns = stamp_ns + rows["offset_ns"].astype(np.int64)
        world = self._path.to_world(rows["xyz"].astype(np.float64), seen_ns, lidar.T_base_lidar)
        left = np.ones(len(rows), bool)
        for view in (view for view in self._views[-len(self._cameras) :] if view.stamp_ns == stamp_ns):
            index = np.flatnonzero(left)
            shown, rgb = self._shown(view, world[index])
            seeds = np.empty(len(shown), _SEED)
            seeds["xyz"], seeds["rgb"] = world[index[shown]], rgb
            seeds["tag"] = rows["tag"][index[shown]]
            left[index[shown]] = False
            self._seeds.append(seeds)
        if sum(map(len, self._seeds)) > _ROWS_MAX:
            self._seeds = [_one_a_cell(self._seeds)]

    def _shown(self, view: _View, world_m: Array) -> tuple[NDArray[np.intp], U8]:
        """Rows of points that a picture shows, and their colours."""
        p, name = view.camera.pinhole, view.camera.name
        at = transforms.apply(transforms.invert(view.T_world_camera), world_m)
        z = at[:, 2]
        depth = np.where(z > 0.1, z, np.nan)
        x, y = view.camera.lens.distort(at[:, 0] / depth, at[:, 1] / depth)
        u, v = np.rint(p.fx_px * x + p.cx_px), np.rint(p.fy_px * y + p.cy_px)
        inside = (u >= 0) & (u < p.width_px) & (v >= 0) & (v < p.height_px)
        # Beyond the rays of a lens its polynomial may fold back into the picture.
        inside &= np.hypot(at[:, 0], at[:, 1]) < 4.0 * np.where(z > 0.1, z, 0.0)
        rows = np.flatnonzero(inside)
        v, u = v[rows].astype(np.intp), u[rows].astype(np.intp)
        kept = np.ones(len(rows), bool)
        if (mask := self._picture(f"{_MASKS}/{name}")) is not None:
            kept &= mask[v, u] > 0
        if (steps := self._picture(f"{_DEPTHS}/{name}")) is not None:
            kept &= np.abs(steps[v, u] * DEPTH_STEP_M - z[rows]) < 0.1 + 0.02 * z[rows]
        bgr = self._picture(f"{_IMAGES}/{name}")
        assert bgr is not None
        return rows[kept], bgr[v[kept], u[kept], ::-1]

    def _picture(self, place: str) -> NDArray[Any] | None:
        data = self._now.get(place)
        return None if data is None else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)

    def _finish(self) -> None:
        self._put_last()
        self._sow()
        seeds = _one_a_cell(self._seeds)
        (self._part / "points3D.ply").write_bytes(
            ply_bytes(
                [
                    *((axis, "<f4", seeds["xyz"][:, k]) for k, axis in enumerate("xyz")),
                    *((name, "|u1", seeds["rgb"][:, k]) for k, name in enumerate(("red", "green", "blue"))),
                    ("tag", "|u1", seeds["tag"]),
                ]
            )
        )
        sparse = self._part / "sparse" / "0"
        shown = {view.camera.name for view in self._views}
        cameras = [camera for name, camera in self._cameras.items() if name in shown]
        numbers = {camera.name: k for k, camera in enumerate(cameras, start=1)}
        (sparse / "cameras.txt").write_text("".join(map(_camera_line, cameras, numbers.values())))
        with (sparse / "images.txt").open("w", encoding="utf-8") as file:
            for number, view in enumerate(self._views, start=1):
                name = self._file(_IMAGES, view.camera.name, view.stamp_ns).removeprefix(f"{_IMAGES}/")
                pose = _pose(transforms.invert(view.T_world_camera))
                file.write(f"{number} {pose} {numbers[view.camera.name]} {name}\n\n")
        self._write_rig(sparse, numbers)
        with (sparse / "points3D.txt").open("w", encoding="utf-8") as file:
            rows = zip(seeds["xyz"].tolist(), seeds["rgb"].tolist(), strict=True)
            file.writelines(
                f"{k} {x:.4f} {y:.4f} {z:.4f} {r} {g} {b} 0\n"
                for k, ((x, y, z), (r, g, b)) in enumerate(rows, 1)
            )
        (self._part / "transforms.json").write_text(json.dumps(self._transforms(), indent=1) + "\n")

    def _write_rig(self, sparse: Path, numbers: Mapping[str, int]) -> None:
        """Write the rig, whose frame is that of its first camera, and its pose at each instant."""
        if not numbers:
            return
        mounts = {name: self._cameras[name].T_base_camera for name in numbers}
        T_base_rig = next(iter(mounts.values()))
        T_camera_rig = {name: transforms.invert(mount) @ T_base_rig for name, mount in mounts.items()}
        others = [f"CAMERA {number} 1 {_pose(T_camera_rig[name])}" for name, number in numbers.items()][1:]
        (sparse / "rigs.txt").write_text(" ".join([f"1 {len(numbers)} CAMERA 1", *others]) + "\n")
        instants = groupby(enumerate(self._views, start=1), lambda numbered: numbered[1].stamp_ns)
        with (sparse / "frames.txt").open("w", encoding="utf-8") as file:
            for frame, (_, numbered) in enumerate(instants, start=1):
                views = list(numbered)
                view = views[0][1]
                pose = _pose(transforms.invert(view.T_world_camera @ T_camera_rig[view.camera.name]))
                images = " ".join(f"CAMERA {numbers[view.camera.name]} {image}" for image, view in views)
                file.write(f"{frame} 1 {pose} {len(views)} {images}\n")

    def _transforms(self) -> dict[str, Any]:
        """The content of ``transforms.json``, of the cameras with the first one's lens model."""
        if not self._views:
            return {"frames": []}
        model = _MODELS[self._views[0].camera.lens.model]
        views = [view for view in self._views if _MODELS[view.camera.lens.model] == model]
        frames = [self._frame(view) for view in views]
        # nerfstudio takes masks and depths of all frames, or of none.
        for key in ("mask_path", "depth_file_path"):
            if not all(key in frame for frame in frames):
                for frame in frames:
                    frame.pop(key, None)
        head = "OPENCV" if model == "PINHOLE" else model
        return {"camera_model": head, "ply_file_path": "points3D.ply", "frames": frames}

    def _frame(self, view: _View) -> dict[str, Any]:
        p, lens, name = view.camera.pinhole, view.camera.lens, view.camera.name
        image = self._file(_IMAGES, name, view.stamp_ns)
        keys = ("k1", "k2", "k3", "k4") if lens.model == "equidistant" else ("k1", "k2", "p1", "p2")
        frame: dict[str, Any] = {
            "file_path": image,
            "timestamp_ns": self.encoder.unix_ns(view.stamp_ns),
            "fl_x": p.fx_px, "fl_y": p.fy_px, "cx": p.cx_px + 0.5, "cy": p.cy_px + 0.5,
            "w": p.width_px, "h": p.height_px,
            **dict(zip(keys, lens.coefficients, strict=True)),
            "transform_matrix": (view.T_world_camera @ _GL).tolist(),
        }  # fmt: skip
        for key, kind in (("mask_path", _MASKS), ("depth_file_path", _DEPTHS)):
            path = self._file(kind, name, view.stamp_ns)
            if path in self._written:
                frame[key] = path
        twins = {twin: f"../../{folder}/{self.target.name}/{image}" for twin, folder in self._twins.items()}
        if CLEAN_PLATE in twins:
            frame[f"{CLEAN_PLATE}_path"] = twins.pop(CLEAN_PLATE)
        if twins:
            frame["weather_paths"] = twins
        return frame


def _one_a_cell(seeds: list[NDArray[np.void]]) -> NDArray[np.void]:
    """The first seed of each cell, in their order."""
    rows = np.concatenate([*seeds, np.empty(0, _SEED)])
    kept: NDArray[np.void] = rows[first_in_cells(rows["xyz"], CELL_M)]
    return kept


def _camera_line(camera: CameraCalibration, number: int) -> str:
    p, lens = camera.pinhole, camera.lens
    values = [p.fx_px, p.fy_px, p.cx_px + 0.5, p.cy_px + 0.5, *(() if lens.is_plain else lens.coefficients)]
    numbers = " ".join(f"{value:.12g}" for value in values)
    return f"{number} {_MODELS[lens.model]} {p.width_px} {p.height_px} {numbers}\n"


def _pose(T: Array) -> str:
    """Quaternion (w first) and translation of a transform."""
    x, y, z, w = transforms.matrix_to_quat(T[:3, :3]).tolist()
    return " ".join(f"{value:.15g}" for value in (w, x, y, z, *T[:3, 3].tolist()))
