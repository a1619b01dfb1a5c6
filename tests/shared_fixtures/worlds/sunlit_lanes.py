"""Brightness of free lanes in the sun, as measured on a photograph: which pixels, and three figures."""

from dataclasses import dataclass

import cv2
import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.transforms import transform
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.mesh import Instances, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import PRESETS

SIZE_PX = (464, 258)
"""Size at which the reference picture is printed."""
DEPTH_M = (4.0, 30.0)
"""Bounds of what counts as road before the car."""
EDGE_M = 0.35
"""What of a lane's borders is left out, where its markings and their dirt are [m]."""
PENUMBRA_M = 0.35
"""Distance from shadows [m]."""
LEAST_PX = 1500
"""Pixels of free lane in sun below which a picture tells nothing."""

Grey = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneBrightness:
    """Figures of one picture or patch."""

    contrast: float
    """Standard deviation of the logarithm of grey."""
    bright_share: float
    """Share of the pixels above 1.4 times the median."""
    step: float
    """Mean horizontal step between neighbours, as a share of the median."""


def lane_brightness(grey: Grey, mask: Mask) -> LaneBrightness:
    """Figures of the masked pixels of a grey picture 0–255."""
    chosen = grey[mask]
    median = float(np.median(chosen))
    both = mask[:, 1:] & mask[:, :-1]
    return LaneBrightness(
        contrast=float(np.log(np.maximum(chosen, 1.0)).std()),
        bright_share=float(np.mean(chosen > 1.4 * median)),
        step=float(np.abs(np.diff(grey, axis=1))[both].mean() / median),
    )


class SunlitLanes:
    """Pictures of one town without traffic at noon, with the pixels on free lanes in the sun."""

    def __init__(self, town: Town, quality: str = "medium") -> None:
        self._town = town
        self._stage = SensorStage(town, seed=1, weather=PRESETS["ClearNoon"], quality=quality)
        self._renderer = self._stage.renderer()
        whole = merge(town.chunks)
        self._rays = o3d.t.geometry.RaycastingScene()
        self._rays.add_triangles(
            o3d.core.Tensor(np.ascontiguousarray(whole.vertices_m, np.float32)),
            o3d.core.Tensor(np.ascontiguousarray(whole.triangles, np.uint32)),
        )
        self._sun = PRESETS["ClearNoon"].sun_direction

    def close(self) -> None:
        """Give the renderer back."""
        self._stage.close()

    def look(self, share: float) -> tuple[NDArray[np.uint8], Grey, Mask]:
        """Colour picture, grey at the reference's size and its mask, at a share of the route."""
        pinhole, pose = left_camera(self._town, share)
        drawn = self._renderer.draw(pinhole, pose, Instances())
        rgb = self._renderer.shade(drawn, PRESETS["ClearNoon"], seed=1)
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
        small = cv2.resize(grey, SIZE_PX, interpolation=cv2.INTER_AREA).astype(np.float64)
        return rgb, small, self._free(pinhole, pose, drawn.depth_m(), drawn.labels()[0])

    def _free(
        self,
        pinhole: Pinhole,
        pose: NDArray[np.float64],
        depth_m: NDArray[np.float32],
        tag: NDArray[np.uint8],
    ) -> Mask:
        road = (tag == Tag.ROAD) & (depth_m > DEPTH_M[0]) & (depth_m < DEPTH_M[1])
        # A small pixel counts where all that it is made of is bare road, and its neighbours too.
        whole = cv2.resize(road.astype(np.float32), SIZE_PX, interpolation=cv2.INTER_AREA) > 0.999
        mask = cv2.erode(whole.astype(np.uint8), np.ones((3, 5), np.uint8)) > 0
        row, column = np.nonzero(mask)
        v = ((row + 0.5) * pinhole.height_px / SIZE_PX[1]).astype(int)
        u = ((column + 0.5) * pinhole.width_px / SIZE_PX[0]).astype(int)
        z = depth_m[v, u].astype(np.float64)
        local = np.stack(
            [(u - pinhole.cx_px) / pinhole.fx_px * z, (v - pinhole.cy_px) / pinhole.fy_px * z, z]
        )
        points = (pose[:3, :3] @ local).T + pose[:3, 3]
        mask[row, column] = self._on_lane(points) & self._in_sun(points)
        return mask

    def _on_lane(self, points_m: NDArray[np.float64]) -> Mask:
        network = self._town.network
        near = network.nearest(points_m)
        width = network.width_m(near.lane, near.station_m)
        outside_junctions = np.array([lane.junction_id is None for lane in network.lanes])
        return outside_junctions[near.lane] & (np.abs(near.offset_m) < 0.5 * width - EDGE_M)

    def _in_sun(self, points_m: NDArray[np.float64]) -> Mask:
        """Whether rays to the sun from a point and from four beside it meet nothing."""
        lit = np.ones(len(points_m), bool)
        for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            start = points_m + np.array([x * PENUMBRA_M, y * PENUMBRA_M, 0.12])
            rays = np.concatenate([start, np.broadcast_to(self._sun, start.shape)], axis=1).astype(np.float32)
            lit &= ~np.isfinite(self._rays.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy())
        return lit


def left_camera(town: Town, share: float) -> tuple[Pinhole, NDArray[np.float64]]:
    """Intrinsics and pose of the paper rig's left camera at a share of the route."""
    assert town.route is not None
    at = town.route.at(np.array([share * town.route.length_m]))
    heading = float(at.heading_rad[0])
    T = transform(at.position_m[0], [0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
    T[:3, 3] -= 1.4 * T[:3, 0]
    camera = next(c for c in rig_by_name("paper").sensors if isinstance(c, CameraConfig))
    return camera.pinhole, T @ camera.mount.T_base_sensor
