"""Views of a `colmap` folder, and splats to begin with."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Arrays = dict[str, Any]


def views_of(folder: Path, camera: str, shrink: int) -> list[Arrays]:
    """Every few pixels of a camera's frames: picture, clean plate, mask, depth, ray; and the pose."""
    frames = json.loads((folder / "transforms.json").read_text())["frames"]
    return [_view(folder, frame, shrink) for frame in frames if f"/{camera}_" in frame["file_path"]]


def _view(folder: Path, frame: dict[str, Any], shrink: int) -> Arrays:
    def read(name: str) -> Any:
        whole: Any = cv2.imread(str(folder / frame[name]), cv2.IMREAD_UNCHANGED)
        # Colours are means of the pixels around.
        whole = cv2.blur(whole, (shrink, shrink)) if whole.ndim == 3 else whole
        return whole[::shrink, ::shrink]

    v, u = np.mgrid[: frame["h"] : shrink, : frame["w"] : shrink] + 0.5
    return {
        "picture": read("file_path").reshape(-1, 3) / 255.0,
        "plate": read("clean_plate_path").reshape(-1, 3) / 255.0,
        "mask": read("mask_path").reshape(-1) > 0,
        "depth": read("depth_file_path").reshape(-1) * 1e-3,
        "ray": np.stack([u - frame["cx"], v - frame["cy"]], axis=-1).reshape(-1, 2) / frame["fl_x"],
        "pixel": shrink / frame["fl_x"],
        "T": np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0]),
    }


def seeds_of(views: list[Arrays]) -> Arrays:
    """Splats of a pixel's size where masks are white and depth is known."""
    found = []
    for view in views:
        shown = view["mask"] & (view["depth"] > 0.5)
        z = view["depth"][shown][:, None]
        local = np.concatenate([view["ray"][shown] * z, z], axis=1)
        world = local @ view["T"][:3, :3].T + view["T"][:3, 3]
        found.append(np.concatenate([world, np.log(0.6 * view["pixel"] * z), view["picture"][shown]], axis=1))
    place, size, colour = np.split(np.concatenate(found), (3, 4), axis=1)
    splats = {"place": place, "size": size[:, 0], "colour": colour, "sky": np.full(3, 0.8)}
    return {**splats, "solid": np.ones(len(size))}
