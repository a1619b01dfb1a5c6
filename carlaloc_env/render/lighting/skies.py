"""Light of weathers on the graphics side: one sky map each, and the irradiance of surfaces under it."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.gl_context import is_software
from carlaloc_env.render.lighting.sky_model import SkyLight, sky_light
from carlaloc_env.weather.parameters import WeatherParameters

CACHED_WEATHERS = 8
"""Weathers whose skies are kept, those used last."""
_C1, _C2, _C3, _C4, _C5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
"""Factors of harmonics in irradiance (Ramamoorthi and Hanrahan 2001, equation 13)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sky:
    """A weather's light, ready for the shaders."""

    light: SkyLight
    polynomial: Array
    """Irradiance [lx] by the normal: 1 y z x xy yz z² xz x²−y², shape (9, 3)."""
    texture: moderngl.Texture
    """Exposed luminance of the upper half-sphere in hemi-octahedral layout."""
    mirrored: moderngl.Texture
    """The same for reflections, blurred more by every level: root of the share of `brightest`, 8 bits."""
    brightest: float
    """Exposed luminance that `mirrored` has as 1."""

    @property
    def above_cd_m2(self) -> Array:
        """Mean luminance over the upper half-sphere, weighted by height, shape (3,)."""
        return np.asarray(np.maximum(np.sum(self.polynomial[[0, 2, 6]], axis=0), 0.0) / np.pi)

    @property
    def round_cd_m2(self) -> Array:
        """Mean luminance of a white ball, a quarter of which the sun lights, shape (3,)."""
        return np.asarray((self.polynomial[0] + self.polynomial[6] / 3.0 + self.light.sun_lx / 4.0) / np.pi)


class Skies:
    """Makes and keeps the skies of the weathers used last."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._kept: OrderedDict[WeatherParameters, Sky] = OrderedDict()

    def of(self, weather: WeatherParameters) -> Sky:
        """The sky of a weather."""
        if weather in self._kept:
            self._kept.move_to_end(weather)
            return self._kept[weather]
        light = sky_light(weather)
        exposed = np.ones((*light.sky_cd_m2.shape[:2], 4), dtype=np.float32)
        exposed[..., :3] = (light.sky_cd_m2 + light.sun_cd_m2) * light.exposure
        texture = self._context.texture(exposed.shape[1::-1], 4, exposed.astype("f2").tobytes(), dtype="f2")
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        # Surfaces mirror the sun as a light of its own.
        exposed[..., :3] = light.sky_cd_m2 * light.exposure
        brightest = max(float(exposed[..., :3].max()), 1e-6)
        self._kept[weather] = Sky(
            light=light,
            polynomial=_polynomial(light.irradiance),
            texture=texture,
            mirrored=self._mirrored(exposed / brightest),
            brightest=brightest,
        )
        if len(self._kept) > CACHED_WEATHERS:
            _, old = self._kept.popitem(last=False)
            old.texture.release()
            old.mirrored.release()
        return self._kept[weather]

    def _mirrored(self, share: NDArray[Any]) -> moderngl.Texture:
        """Texture of 8 bits with all its levels, which a CPU reads in half the time of one of 16."""
        texture = self._context.texture(share.shape[1::-1], 4)
        texture.build_mipmaps()
        # Texels are a third of a degree wide: a CPU does without the mean of four, half of what a look costs.
        between = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)
        smooth = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        texture.filter = between if is_software(self._context) else smooth
        texture.repeat_x = texture.repeat_y = False
        for level in range(share.shape[0].bit_length()):
            codes = np.rint(255.0 * np.sqrt(np.clip(share, 0.0, 1.0))).astype(np.uint8)
            texture.write(codes.tobytes(), level=level)
            if len(share) > 1:
                share = 0.25 * (share[::2, ::2] + share[1::2, ::2] + share[::2, 1::2] + share[1::2, 1::2])
        return texture

    def release(self) -> None:
        """Free all textures."""
        for sky in self._kept.values():
            sky.texture.release()
            sky.mirrored.release()


def _polynomial(harmonics: Array) -> Array:
    """Irradiance as a polynomial in the normal: 1 y z x xy yz z² xz x²−y², shape (9, 3)."""
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = harmonics
    linear = (2 * _C2 * factor for factor in (l1m1, l10, l11))
    square = (2 * _C1 * l2m2, 2 * _C1 * l2m1, _C3 * l20, 2 * _C1 * l21, _C1 * l22)
    return np.stack([_C4 * l00 - _C5 * l20, *linear, *square])
