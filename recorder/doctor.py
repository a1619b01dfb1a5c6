"""Checks this machine: the parts that work, their speed, and packages to install for the others."""

import os
import platform
import re
import shutil
import timeit
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.core.files.array_cache import cache_bound_bytes, cache_files, default_cache_dir
from carlaloc_env.core.files.library_versions import installed_distributions
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import weather_by_name

_ONE_PYBULLET = (
    "pip uninstall pybullet pybullet-arm64, then install CarlaLoc again: pip takes the one that has a wheel"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Result of one check."""

    name: str
    """Name of the check."""
    works: bool
    """Whether it works."""
    needed: bool
    """Whether something stops working without it."""
    detail: str
    """Version, speed, or what is wrong."""
    remedy: str = ""
    """What to do if it does not work."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorReport:
    """Result of all checks."""

    findings: tuple[Finding, ...]
    quality: str
    """Quality tier of pictures that suits this machine."""

    @property
    def healthy(self) -> bool:
        """Whether everything that is needed works."""
        return all(finding.works for finding in self.findings if finding.needed)


def examine(out: Path | None = None) -> DoctorReport:
    """Check Python, OpenGL, Embree, PyBullet, devices, disk and optional parts.

    Args:
        out: Folder whose disk is looked at; the present one when left out.
    """
    graphics = _guarded(
        "OpenGL", _graphics, needed=True, remedy="apt-get install libegl1 libgl1 libgl1-mesa-dri"
    )
    draws_on_cores = any(word in graphics.detail.lower() for word in ("llvmpipe", "softpipe", "swrast"))
    findings = (
        _finding("Python", True, _python(), needed=True),
        graphics,
        _gpu(_gpus(Path("/")), is_used=graphics.works and not draws_on_cores),
        _guarded("ray casting", _rays, needed=True, remedy="apt-get install libgomp1 libusb-1.0-0 libidn2-0"),
        _guarded("physics", _physics, needed=True, remedy=_ONE_PYBULLET),
        _guarded("joystick", _joystick, needed=False, remedy="none is needed: the scripted driver drives"),
        _disk(out or Path.cwd()),
        _cache(),
        _optional("kiss_icp", "`carlaloc odometry`", "slam"),
        _optional("small_gicp", "LiDAR odometry in `carlaloc demo`", "slam"),
        _optional("rko_lio", "LiDAR-inertial odometry in `carlaloc demo`", "slam"),
        _optional("matplotlib", "trajectory plots", "report"),
    )
    quality = "high" if graphics.works and not draws_on_cores else "medium"
    return DoctorReport(findings=findings, quality=quality)


def _guarded(name: str, check: Callable[[], tuple[bool, str]], *, needed: bool, remedy: str) -> Finding:
    try:
        works, detail = check()
    except (CarlaLocError, ImportError, OSError, RuntimeError) as error:
        works, detail = False, " ".join(str(error).split()) or type(error).__name__
    return _finding(name, works, detail, remedy, needed=needed)


def _finding(name: str, works: bool, detail: str, remedy: str = "", *, needed: bool = False) -> Finding:
    return Finding(name=name, works=works, needed=needed, detail=detail, remedy="" if works else remedy)


def _python() -> str:
    usable, total = len(usable_cores()), os.cpu_count() or 1
    cores = f"{total} cores" if usable == total else f"{usable} of {total} cores may be used"
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}, {cores}"


def _graphics() -> tuple[bool, str]:
    from carlaloc_env.render.renderer import SceneRenderer

    with SceneRenderer([_ground()], ModelLibrary({})) as renderer:
        camera, pose = Pinhole(), np.eye(4)
        pose[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
        pose[:3, 3] = (0.0, 0.0, 1.6)
        weather = weather_by_name("ClearNoon")

        def draw() -> None:
            picture = renderer.draw(camera, pose, Instances())
            renderer.shade(picture, weather, stamp_ns=0, seed=0)
            picture.depth_m()

        best_s = min(timeit.repeat(draw, number=1, repeat=3))
        return True, f"{renderer.driver}; {best_s * 1e3:.0f} ms per 1280×720 picture of an empty scene"


_MAKERS = {"0x10de": "NVIDIA", "0x1002": "AMD", "0x8086": "Intel"}
"""Makers of GPUs by their PCI numbers."""


def _gpus(root: Path) -> list[str]:
    """Names of the GPUs that the system shows, or those of their makers."""
    abouts = [path.read_text() for path in sorted(root.glob("proc/driver/nvidia/gpus/*/information"))]
    models = [name for about in abouts for name in re.findall(r"^Model:\s*(.+)$", about, re.MULTILINE)]
    if not models:
        models = ["NVIDIA"] * len(list(root.glob("dev/nvidia[0-9]*")))
    makers = [path.read_text().strip() for path in sorted(root.glob("sys/class/drm/renderD*/device/vendor"))]
    maker_names = [_MAKERS[maker] for maker in makers if maker in _MAKERS]
    return models + [maker for maker in maker_names if maker != "NVIDIA" or not models]


def _gpu(gpus: Sequence[str], *, is_used: bool) -> Finding:
    """Whether pictures are drawn by the GPU that is there, if there is one."""
    if not gpus:
        return _finding("GPU", True, "none found; pictures are drawn without")
    detail = f"{', '.join(gpus)}: {'draws the pictures' if is_used else 'there, but not used by OpenGL'}"
    remedy = "give OpenGL the GPU: docs/install.md#a-gpu-for-opengl"
    return _finding("GPU", is_used, detail, remedy)


def _rays() -> tuple[bool, str]:
    from carlaloc_env.raycast import RayScene
    from carlaloc_env.timeline.actors import empty_catalog
    from carlaloc_env.timeline.ego_spline import EgoTrack
    from carlaloc_env.timeline.timeline import Timeline

    scene = RayScene([_ground()], ModelLibrary({}))
    count = 66_496
    azimuth = np.linspace(0.0, 2 * np.pi, count)
    directions = np.stack([np.cos(azimuth), np.sin(azimuth), np.full(count, -0.1)], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    origins = np.broadcast_to([0.0, 0.0, 1.9], (count, 3))
    parked = EgoTrack.from_arrays(np.full((4, 3), 30.0), np.tile([0.0, 0.0, 0.0, 1.0], (4, 1)))
    timeline = Timeline(empty_catalog(), ego=parked)
    rays = (origins, directions, np.zeros(count, np.int64), timeline, 120.0)
    # The first call in a fresh install compiles for a while.
    best_s = min(timeit.repeat(lambda: scene.cast(*rays), number=1, repeat=3))
    return True, f"Embree, {count / best_s / 1e6:.1f} M rays/s"


def _physics() -> tuple[bool, str]:
    builds = installed_distributions("pybullet")
    if len(builds) > 1:
        return False, f"{' and '.join(builds)} are both installed, and both bring the module pybullet"
    from carlaloc_env.physics.ego import EgoCar
    from carlaloc_env.physics.world import PhysicsWorld

    ground = _ground()
    world = PhysicsWorld(ground.vertices_m, ground.triangles)
    car = EgoCar(world)
    car.reset((0.0, 0.0, 0.0), 0.0)
    per_tick_s = timeit.timeit(lambda: car.tick(Controls(throttle=0.3)), number=400) / 400
    world.close()
    build = "".join(f" {version} ({name})" for name, version in builds.items())
    return True, f"PyBullet{build}, {TICK_S / per_tick_s:.0f}× real time on an empty road"


def _joystick() -> tuple[bool, str]:
    if len(installed_distributions("pygame")) > 1:
        return False, "pygame and pygame-ce are both installed: uninstall both by pip, then install pygame-ce"
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    import pygame

    pygame.joystick.init()
    names = [pygame.joystick.Joystick(k).get_name() for k in range(pygame.joystick.get_count())]
    pygame.joystick.quit()
    return bool(names), ", ".join(names) or "none plugged in"


def _disk(folder: Path) -> Finding:
    while not folder.exists():
        folder = folder.parent
    free_gb = shutil.disk_usage(folder).free / 1e9
    detail = f"{free_gb:.1f} GB free in {folder}; a minute of the paper's rig makes a bag of about 20 GB"
    return _finding("disk", free_gb > 5.0, detail, "choose another folder with --out or free some space")


def _cache() -> Finding:
    size, bound = sum(size for _, size in cache_files()), cache_bound_bytes()
    detail = f"{size / 1e9:.1f} GB in {default_cache_dir()}, at most {bound / 1e9:g} GB ($CARLALOC_CACHE_GB)"
    return _finding("cache", True, f"{detail}; `carlaloc doctor --clear-cache` empties it")


def _optional(module: str, purpose: str, extra: str) -> Finding:
    remedy = f'pip install "carlaloc[{extra}]"'
    return _finding(module, find_spec(module) is not None, f"for {purpose}", remedy)


def _ground() -> Mesh:
    corners = [(-500, -500, 0), (500, -500, 0), (500, 500, 0), (-500, 500, 0)]
    return make_mesh(corners, [(0, 1, 2), (0, 2, 3)], material=Material.ASPHALT, tag=Tag.ROAD)
