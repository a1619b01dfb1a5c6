"""The passes that shade a picture: in one piece, or tile by tile with the loops that each tile needs."""

from collections.abc import Callable
from dataclasses import dataclass

import moderngl

from carlaloc_env.render.lighting.light_tiles import TILE_PX, TileGroups
from carlaloc_env.render.shader_programs import Programs
from carlaloc_env.render.views import CameraView

_SKY_FEATURES = ("TILES", "NIGHT", "LINEAR", "GLOWS")
"""Features that the sky's program has."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cover:
    """Tiles of a picture and what draws them."""

    groups: TileGroups
    draw: Callable[[moderngl.Program, int, int], None]
    """Draws tiles of `groups`: program, first tile, how many."""
    view: CameraView

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of all tiles together."""
        camera = self.view.camera
        return -(-camera.width_px // TILE_PX) * TILE_PX, -(-camera.height_px // TILE_PX) * TILE_PX


class ShadingPasses:
    """Draws surfaces and the sky of one picture."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        features: tuple[str, ...],
        prepare: Callable[[moderngl.Program], None],
        *,
        splits: bool,
    ) -> None:
        """Make ready.

        Args:
            context: Where it is drawn; the picture's framebuffer is bound.
            programs: Shader programs of the context.
            features: Features of the program of the picture's surfaces.
            prepare: Sets the uniforms of a program.
            splits: Whether a pixel is either surface or sky; otherwise surfaces are laid over their sky.
        """
        self._context = context
        self._programs = programs
        self._features = features
        self._prepare = prepare
        self._splits = splits
        self._prepared: set[int] = set()

    def whole(self, triangle: Callable[[moderngl.Program], None]) -> None:
        """Draw all in one piece."""
        # The depth test splits the picture: surfaces lie before the triangle, the sky on it.
        self._test(">" if self._splits else "")
        triangle(self._program("shade.frag", self._features))
        if self._splits:
            self._test("==")
            triangle(self._program("sky.frag", self._features))

    def tiles(self, cover: Cover) -> None:
        """Draw tile by tile; tiles without sky, or of nothing else, need no test."""
        for kind, (first, count) in cover.groups.groups.items():
            if not count:
                continue
            features = (*self._features, "TILES", *kind)
            program = self._program("shade.frag", features)
            self._test("")
            if not self._splits:
                cover.draw(program, first, count)
                continue
            cover.draw(program, *cover.groups.of(kind, (0, 0)))
            self._test(">")
            cover.draw(program, *cover.groups.of(kind, (1, 1)))
            first, count = cover.groups.of(kind, (1, 2))
            if count:
                self._test("==")
                cover.draw(self._program("sky.frag", features), first, count)

    def _program(self, fragment: str, features: tuple[str, ...]) -> moderngl.Program:
        if fragment == "sky.frag":
            features = tuple(name for name in features if name in _SKY_FEATURES)
        program = self._programs.get("screen.vert", fragment, *features)
        if program.glo not in self._prepared:
            self._prepare(program)
            self._prepared.add(program.glo)
        return program

    def _test(self, function: str) -> None:
        """Compare with the depths of surfaces before shading a pixel, or with '' do not."""
        test = moderngl.DEPTH_TEST if function else moderngl.NOTHING
        self._context.enable_only(test | moderngl.PROGRAM_POINT_SIZE)
        if function:
            self._context.depth_func = function
