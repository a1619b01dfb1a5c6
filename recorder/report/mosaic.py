"""Panels of colour, depth, semantics and the LiDAR from above, joined to one image of an instant."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from carlaloc_env.core.array_types import U8
from carlaloc_env.samples import DepthImage, Image, PointCloud, SemanticImage
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS, colourise

DEPTH_RANGE_M = (2.0, 200.0)
"""Depths shown from black to white on a logarithmic scale [m]."""
LIDAR_REACH_M = 42.0
"""Half the width of the view from above [m]."""
STILL_RGB, MOVING_RGB = (60, 230, 60), (255, 190, 40)
"""Colours of points in the view from above, sRGB."""
PANELS = {"rgb": "RGB", "depth": "depth", "semantic": "semantic", "cloud": "LiDAR from above"}
"""Labels of a mosaic's panels, by name, in their order."""
PANEL_WIDTH_PX, PANEL_HEIGHT_PX = 640, 360
"""Size of a panel [px]."""
_COLOUR_OF_TAG = np.tile(np.array(STILL_RGB, np.uint8), (256, 1))
_COLOUR_OF_TAG[[int(tag) for tag in DYNAMIC_TAGS]] = MOVING_RGB


def depth_image(depth: DepthImage) -> U8:
    """Grey sRGB image (H, W, 3) of a depth image: near is dark, the sky white."""
    near, far = np.log(DEPTH_RANGE_M)
    z = np.where(depth.depth_m > 0, depth.depth_m, DEPTH_RANGE_M[1])
    grey = np.clip((np.log(np.maximum(z, 0.1)) - near) / (far - near), 0.0, 1.0)
    return np.repeat((grey * 255).astype(np.uint8)[..., None], 3, axis=-1)


def semantic_image(semantic: SemanticImage) -> U8:
    """The semantic image in CARLA's colours, sRGB (H, W, 3)."""
    return colourise(semantic.tag)


def lidar_image(cloud: PointCloud, width_px: int, height_px: int) -> U8:
    """A point cloud from above, the car's nose up, sRGB (height, width, 3); moving things are amber."""
    scale = width_px / (2 * LIDAR_REACH_M)
    u = np.round(width_px / 2 - cloud.points_xyz_m[:, 1] * scale).astype(np.int64)
    v = np.round(height_px / 2 - cloud.points_xyz_m[:, 0] * scale).astype(np.int64)
    seen = (u >= 0) & (u < width_px) & (v >= 0) & (v < height_px)
    image = np.zeros((height_px, width_px, 3), np.uint8)
    image[v[seen], u[seen]] = STILL_RGB if cloud.tag is None else _COLOUR_OF_TAG[cloud.tag[seen]]
    return image


def panel_of(sample: Image | DepthImage | SemanticImage | PointCloud) -> U8:
    """The panel of one sample, sRGB, of shape (PANEL_HEIGHT_PX, PANEL_WIDTH_PX, 3)."""
    if isinstance(sample, Image):
        return labelled_panel(sample.rgb, PANELS["rgb"])
    if isinstance(sample, DepthImage):
        return labelled_panel(depth_image(sample), PANELS["depth"])
    if isinstance(sample, SemanticImage):
        return labelled_panel(semantic_image(sample), PANELS["semantic"])
    return labelled_panel(lidar_image(sample, PANEL_WIDTH_PX, PANEL_HEIGHT_PX), PANELS["cloud"])


def joined(panels: Mapping[str, U8], places: Sequence[str] = tuple(PANELS), *, caption: str = "") -> U8:
    """A mosaic of panels: up to three in a row, four in a square.

    Args:
        panels: Panels by their names in `PANELS`; one whose place is kept but which is not there is black.
        places: Names of all panels that have a place, in their order.
        caption: Text below on the left.

    Returns:
        The image, sRGB, shape (H, W, 3), in an array of its own.
    """
    black = np.zeros((PANEL_HEIGHT_PX, PANEL_WIDTH_PX, 3), np.uint8)
    each = [panels[name] if name in panels else labelled_panel(black, PANELS[name]) for name in places]
    columns = len(each) if len(each) <= 3 else 2
    image = np.vstack([np.hstack(each[k : k + columns]) for k in range(0, len(each), columns)])
    if caption:
        _label(image, caption, (12, image.shape[0] - 12))
    return image


def panels_in(mosaic: U8) -> list[U8]:
    """The panels of an image of `joined`, in their order; an image of another size is one panel."""
    height, width = mosaic.shape[:2]
    if height % PANEL_HEIGHT_PX or width % PANEL_WIDTH_PX:
        return [mosaic]
    rows = np.split(mosaic, height // PANEL_HEIGHT_PX)
    return [panel for row in rows for panel in np.split(row, width // PANEL_WIDTH_PX, axis=1)]


def labelled_panel(image: U8, text: str) -> U8:
    """An sRGB image in the size of a panel, its label at the top left."""
    size_px = (PANEL_WIDTH_PX, PANEL_HEIGHT_PX)
    shrink = image.shape[1] > PANEL_WIDTH_PX
    resized = cv2.resize(image, size_px, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_NEAREST)
    panel: U8 = np.ascontiguousarray(resized, dtype=np.uint8)
    _label(panel, text, (12, 24))
    return panel


def _label(image: U8, text: str, position_px: tuple[int, int]) -> None:
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.6
    (width, height), below = cv2.getTextSize(text, font, scale, 1)
    x, y = position_px
    cv2.rectangle(image, (x - 5, y - height - 5), (x + width + 5, y + below), (0, 0, 0), -1)
    cv2.putText(image, text, position_px, font, scale, (255, 255, 255), 1, cv2.LINE_AA)
