"""Where snow lies: shelter under roofs and cleared wheel tracks, seen from straight above."""

import moderngl
import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.geometry.static_scene import StaticScene
from carlaloc_env.render.lighting.roof_heights import Roofs
from carlaloc_env.render.shader_programs import Programs
from carlaloc_env.road.wheel_tracks import WheelTracks


class SnowMap:
    """Texture of distances from the nearest lane's middle, its height, and that of the highest roof [m]."""

    def __init__(
        self, context: moderngl.Context, programs: Programs, scenery: StaticScene, tracks: WheelTracks
    ) -> None:
        roofs = Roofs(context, programs, scenery, leaves=False)
        roofs.texture.release()
        rows, columns, _ = tracks.lanes.shape
        self._low_m, self._size_m = tracks.low_m, tracks.cell_m * np.array([columns, rows])
        east, north = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        cells_m = tracks.low_m + tracks.cell_m * np.stack([east, north], axis=-1).reshape(-1, 2)
        heights = roofs.heights_m(cells_m).reshape(rows, columns, 1)
        texels = np.concatenate([tracks.lanes, heights], axis=2, dtype=np.float32)
        self.texture = context.texture((columns, rows), 3, texels.tobytes(), dtype="f4")
        self.texture.repeat_x = self.texture.repeat_y = False

    def frame(self, eye_m: Array) -> tuple[float, float, float, float]:
        """Scale (2) and offset (2) from horizontal offsets of the eye [m] to texture coordinates."""
        return (*(1.0 / self._size_m), *((eye_m[:2] - self._low_m) / self._size_m))
