"""The G-buffer: surfaces that a camera sees before any weather, kept on the graphics side."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.views import CameraView
from carlaloc_env.scene.mesh import Instances
from carlaloc_env.scene.semantic_tags import Tag

_T = TypeVar("_T", np.float32, np.uint32, np.uint16)
"""Type of the samples of one texture."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Targets:
    """Textures of one G-buffer, one texel per sample, top row first."""

    albedo: moderngl.Texture
    """Square root of the linear albedo; alpha 1 = covered."""
    normal: moderngl.Texture
    """Octahedral world normal, 16 bits per channel."""
    surface: moderngl.Texture
    """Roughness, porosity, light given off by day and night, light given off at night (log code)."""
    depth: moderngl.Texture
    """Planar depth [m], 0 = sky."""
    id: moderngl.Texture | None
    """(Tag << 24 | instance) xor `SKY_ID`; None in a resolved buffer."""
    zbuffer: moderngl.Texture | None
    """Depth-test values; None in a resolved buffer."""
    framebuffer: moderngl.Framebuffer

    @classmethod
    def create(
        cls,
        context: moderngl.Context,
        size_px: tuple[int, int],
        *,
        resolved: bool = False,
        smooth: bool = False,
    ) -> Targets:
        """Textures of a size; a resolved buffer has no ids and no depth test.

        They are read between texels where they are to be resolved, which costs a CPU twice as much.
        """
        albedo = context.texture(size_px, 4)
        normal = context.texture(size_px, 2, dtype="nu2")
        surface = context.texture(size_px, 4)
        depth = context.texture(size_px, 1, dtype="f4")
        colours = [albedo, normal, surface, depth]
        identity = zbuffer = None
        if not resolved:
            identity = context.texture(size_px, 1, dtype="u4")
            identity.filter = (moderngl.NEAREST, moderngl.NEAREST)
            zbuffer = context.depth_texture(size_px)
            zbuffer.compare_func = ""
            colours.insert(3, identity)
        mode = moderngl.LINEAR if smooth else moderngl.NEAREST
        for texture in (albedo, normal, surface, depth):
            texture.repeat_x = texture.repeat_y = False
            texture.filter = (mode, mode)
        return cls(
            albedo=albedo,
            normal=normal,
            surface=surface,
            depth=depth,
            id=identity,
            zbuffer=zbuffer,
            framebuffer=context.framebuffer(colours, zbuffer),
        )

    def textures(self) -> list[moderngl.Texture]:
        """All textures."""
        parts = [self.albedo, self.normal, self.surface, self.depth, self.id, self.zbuffer]
        return [texture for texture in parts if texture is not None]

    def clear(self) -> None:
        """Clear the picture to sky alone; textures that are read at surfaces only keep their content."""
        framebuffer: Any = self.framebuffer
        averaged = self.id is None or self.albedo.filter[0] == moderngl.LINEAR
        wiped = framebuffer.color_attachments if averaged else (self.id, self.depth)
        framebuffer.color_mask = [(part in wiped,) * 4 for part in framebuffer.color_attachments]
        framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        framebuffer.color_mask = [(True,) * 4] * len(framebuffer.color_attachments)

    def release(self) -> None:
        """Free the graphics memory."""
        self.framebuffer.release()
        for texture in self.textures():
            texture.release()


class GBuffer:
    """Picture of one camera at one instant; stays valid until it is dropped or the renderer closed."""

    def __init__(
        self,
        *,
        context: moderngl.Context,
        view: CameraView,
        drawn: Targets,
        shaded: Targets,
        actors: Instances,
    ) -> None:
        self.view = view
        self.drawn = drawn
        """Samples as drawn: ids and depth come from here."""
        self.shaded = shaded
        """Samples that shading reads: the same, or resolved to one per pixel."""
        self.actors = actors
        """Instances that were drawn; their shadows depend on the sun of each weather."""
        self._context = context
        self._samples: tuple[NDArray[np.float32], NDArray[np.uint32]] | None = None
        self._depth_m: NDArray[np.float32] | None = None
        self._normal_codes: NDArray[np.uint16] | None = None

    @property
    def camera(self) -> Pinhole:
        """Intrinsics it was drawn with."""
        return self.view.camera

    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth along the optical axis at pixel centres [m], 0 = sky, shape (H, W)."""
        if self.shaded is self.drawn:
            return self.shaded_depth_m().copy()
        return self._centred(self._read(self.drawn.depth, np.float32))

    def shaded_depth_m(self) -> NDArray[np.float32]:
        """Planar depth of what is shaded [m], 0 = sky, shape (H, W), read-only; read back once."""
        if self._depth_m is None:
            self._depth_m = self._read(self.shaded.depth, np.float32).reshape(self._shape)
        return self._depth_m

    def shaded_normal_codes(self) -> NDArray[np.uint16]:
        """Octahedral world normals of what is shaded, shape (H, W, 2), read-only; read back once."""
        if self._normal_codes is None:
            self._normal_codes = self._read(self.shaded.normal, np.uint16).reshape(*self._shape, 2)
        return self._normal_codes

    @property
    def _shape(self) -> tuple[int, int]:
        return self.camera.height_px, self.camera.width_px

    def labels(self) -> tuple[NDArray[np.uint8], NDArray[np.uint32]]:
        """Semantic `Tag` and instance id (0 = none) at pixel centres, both of shape (H, W)."""
        assert self.drawn.id is not None
        code = self._centred(self._read(self.drawn.id, np.uint32))
        # The tag is the last byte, the only one that the sky's code changes.
        tag = code.view(np.uint8)[:, 3::4] ^ np.uint8(Tag.SKY)
        return tag, code & np.uint32(0xFFFFFF)

    def samples(self) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        """Depth [m] and instance id of all samples as drawn, both of the shape of the drawn grid.

        They are kept, so that they can be read again while the graphics are busy.
        """
        if self._samples is not None:
            return self._samples
        assert self.drawn.id is not None
        shape = self.view.size_px[::-1]
        instance = self._read(self.drawn.id, np.uint32) & np.uint32(0xFFFFFF)
        self._samples = self._read(self.drawn.depth, np.float32).reshape(shape), instance.reshape(shape)
        return self._samples

    def normals(self) -> NDArray[np.float32]:
        """Unit shading normals at pixel centres in the optical frame, zero for the sky, shape (H, W, 3)."""
        width, height = self.view.size_px
        step = self.view.subsamples
        code = self._read(self.drawn.normal, np.uint16).reshape(height, width, 2)[::step, ::step]
        p = code.astype(np.float32) * np.float32(2 / 65535) - np.float32(1)
        n = np.empty((*p.shape[:2], 3), np.float32)
        n[..., 2] = np.float32(1) - np.abs(p[..., 0]) - np.abs(p[..., 1])
        fold = np.maximum(-n[..., 2:], np.float32(0))
        n[..., :2] = p - np.where(p >= 0, fold, -fold)
        n /= np.sqrt(np.sum(n * n, axis=2, keepdims=True))
        R = self.view.R_camera_world.astype(np.float32)
        # Written out without BLAS, so that the normals have the same bits on every machine.
        turned = np.stack([np.sum(n * R[axis], axis=2) for axis in range(3)], axis=2)
        turned[self.depth_m() == 0] = 0
        return turned

    def _read(self, texture: moderngl.Texture, dtype: type[_T]) -> NDArray[_T]:
        with self._context:
            return np.frombuffer(texture.read(), dtype=dtype)

    def _centred(self, samples: NDArray[_T]) -> NDArray[_T]:
        width, height = self.view.size_px
        step = self.view.subsamples
        return np.ascontiguousarray(samples.reshape(height, width)[::step, ::step])


SKY_ID = int(Tag.SKY) << 24
"""Id of the sky; ids are stored xor this, so that a cleared texture means sky."""


class TargetPool:
    """Textures to draw into, handed out again when the G-buffer that held them is dropped."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._free: dict[tuple[int, int, bool], list[Targets]] = {}
        self._all: list[Targets] = []

    def take(self, size_px: tuple[int, int], *, resolved: bool = False, smooth: bool = False) -> Targets:
        """Unused textures of a size; one renderer reads all unresolved ones alike."""
        free = self._free.setdefault((*size_px, resolved), [])
        if free:
            return free.pop()
        targets = Targets.create(self._context, size_px, resolved=resolved, smooth=smooth)
        self._all.append(targets)
        return targets

    def give_back_with(self, owner: GBuffer) -> None:
        """Arrange that the textures of a G-buffer become free when it is dropped."""
        held = {id(part): part for part in (owner.drawn, owner.shaded)}
        for part in held.values():
            free = self._free[(*part.albedo.size, part.id is None)]
            weakref.finalize(owner, free.append, part)

    def release(self) -> None:
        """Free all textures."""
        for targets in self._all:
            targets.release()
        self._all.clear()
        self._free.clear()
