"""Savings of the renderer's optimisations: `python benchmarks/acceleration.py [--repeat N] [NAME ...]`.

One stereo frame of the paper's rig in Town03 among 60 actors (see stereo.py), with each optimisation and with
the direct method, in turns. Prints the shortest wall-clock and CPU times and the share of the frame time that
the optimisation saves; docs/performance.md has the table.
"""

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any
from unittest.mock import patch

import numpy as np
from stereo import Instant

from carlaloc_env.render.geometry.mesh_buffers import MeshBuffers
from carlaloc_env.render.lighting import night_lighting
from carlaloc_env.render.lighting import night_lighting as tiled_lights
from carlaloc_env.render.lighting.light_grid import LOOPS, Fog, LightGrid
from carlaloc_env.render.lighting.light_sources import Lights
from carlaloc_env.render.lighting.light_tiles import DepthRange, TileGroups, every_tile
from carlaloc_env.render.renderer import SceneRenderer

Plain = Callable[[SceneRenderer], AbstractContextManager[object]]


@contextlib.contextmanager
def plain_uniforms(renderer: SceneRenderer) -> Iterator[None]:
    """Programs as they are written; the others are kept."""
    programs = renderer._programs
    kept, programs._programs, programs._hoists = programs._programs, _UNIFORMS, False
    yield
    programs._programs, programs._hoists = kept, True


_UNIFORMS: dict[Any, Any] = {}
"""Programs without hoisted uniforms."""


def all_triangles(_: SceneRenderer) -> AbstractContextManager[object]:
    """Every triangle of what may be seen goes to the driver."""
    draw = MeshBuffers.draw

    def whole(self: MeshBuffers, *rest: Any, culler: object = None, **more: Any) -> None:
        draw(self, *rest, **more)

    return patch.object(MeshBuffers, "draw", whole)


def one_list(_: SceneRenderer) -> AbstractContextManager[object]:
    """All lights near the camera for every tile."""

    def grid(
        _: object, lights: Lights, depths: DepthRange, *, exposure: float, fog: Fog, **__: object
    ) -> LightGrid:
        tiles, every = every_tile(depths.near_m.shape), np.arange(len(lights))
        lamps, beams = every[~lights.beam], every[lights.beam]
        first = 1
        for name, some in (("glows", every), ("lamps", lamps), ("beams", beams)):
            tiles[name] = (first, first + len(some)) if len(some) else (0, 1)
            first += len(some)
        kinds = np.full(len(tiles), len(LOOPS) - 1)
        return LightGrid(
            lights=lights,
            glow_range_m=fog.glow_range_m(lights, exposure),
            groups=TileGroups.sorted_by(tiles, kinds, LOOPS, depths.shown.ravel()),
            entries=np.concatenate([[-1], every, lamps, beams]),
            glow_count=1 + len(every),
        )

    return patch.object(night_lighting, "light_grid", grid)


def spheres_only(_: SceneRenderer) -> AbstractContextManager[object]:
    """Lamps in the lists of all tiles that their spheres reach, without a test of the surfaces."""
    return patch.object(tiled_lights, "_keep_lit", lambda *_: None)


SHORT_CUTS: dict[str, tuple[Plain, tuple[str, ...]]] = {
    "uniform_hoisting": (plain_uniforms, ("ClearNoon", "RainyNight")),
    "triangle_culling": (all_triangles, ("ClearNoon", "RainyNight")),
    "tiled_lights": (one_list, ("RainyNight",)),
    "surface_light_culling": (spheres_only, ("RainyNight",)),
}
"""The direct method in place of each, and the weathers in which it is measured."""


def measure(instant: Instant, name: str, weather: str, repeat: int) -> None:
    """Time one optimisation and print a line."""
    plain, _ = SHORT_CUTS[name]
    wall: tuple[list[float], list[float]] = ([], [])
    cpu: tuple[list[float], list[float]] = ([], [])
    for turn in range(2 * repeat + 2):
        which = (turn + turn // 2) % 2
        with plain(instant.renderer) if which else contextlib.nullcontext():
            began, cpu_began = time.perf_counter(), time.process_time()
            instant.draw((weather,))
            took = time.perf_counter() - began, time.process_time() - cpu_began
        if turn > 1:
            wall[which].append(took[0])
            cpu[which].append(took[1])
    buys = [100.0 * (min(times[1]) / min(times[0]) - 1.0) for times in (wall, cpu)]
    print(
        f"{name:<22} {weather:<10} with {min(wall[0]):.3f} s, CPU {min(cpu[0]):.3f} s; "
        f"without {min(wall[1]):.3f} s, CPU {min(cpu[1]):.3f} s; buys {buys[0]:+.0f} %, CPU {buys[1]:+.0f} %"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="all when left out: " + ", ".join(SHORT_CUTS))
    parser.add_argument("--repeat", type=int, default=15, help="instants that are timed, of each way (15)")
    arguments = parser.parse_args()
    one = Instant("Town03", share=0.3, quality="medium")
    for short_cut in arguments.names or SHORT_CUTS:
        for under in SHORT_CUTS[short_cut][1]:
            measure(one, short_cut, under, arguments.repeat)
    one.stage.close()
