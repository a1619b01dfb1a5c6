"""The camera sensor: streams, poses over a Timeline, and sharing of geometry between weathers."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.worlds.plain_albedo import plain_albedo
from shared_fixtures.worlds.render_scenes import need_opengl
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.render.renderer import SceneRenderer
from carlaloc_env.road.wheel_tracks import no_tracks
from carlaloc_env.samples import DepthImage, Image, SemanticImage
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera import CameraSensor
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.presets import PRESETS

need_opengl()

PINHOLE = Pinhole(width_px=320, height_px=180, fx_px=160.0, fy_px=160.0, cx_px=160.0, cy_px=90.0)
SPEED_MPS = 10.0
ACTOR_AHEAD_M = 20.0


class SmallWorld:
    """Level ground, a box for a car, a box for the ego; satisfies the sensors' `World`."""

    def __init__(self) -> None:
        self.seed = 7
        self.geo = GeoReference(latitude_deg=49.0, longitude_deg=8.4, height_m=115.0)
        self.weather = PRESETS["ClearNoon"]
        self.roughness = None
        self.wheel_tracks = no_tracks
        lens = Scenery.box((0, -0.15, -0.15), (0.02, 0.15, 0.15), Material.LAMP_RED, Tag.TRAFFIC_LIGHT)
        self.library = ModelLibrary(
            {
                "saloon": Scenery.box((-2.3, -0.9, 0.0), (2.3, 0.9, 1.4), Material.CAR_PAINT, Tag.CAR),
                "ego": Scenery.box((-0.9, -0.9, 0.3), (3.7, 0.9, 0.9), Material.CAR_PAINT, Tag.CAR),
                **{f"signal_{colour}": lens for colour in ("red", "yellow", "green")},
            }
        )
        self.lenses = SignalLenses(
            signal=np.zeros(1, np.int32),
            state=np.array([1], np.uint8),
            T_world_lens=transforms.transform(
                [[30.0, 4.0, 4.0]], transforms.rpy_to_quat([0.0], [0.0], [np.pi])
            ),
            instance=np.array([55], np.uint32),
        )
        ground = Scenery.ground()
        self._renderer = SceneRenderer([ground], self.library, quality="low", albedo=plain_albedo())

    def renderer(self) -> SceneRenderer:
        return self._renderer

    def rays(self) -> None:  # type: ignore[override]
        raise AssertionError("cameras cast no rays")


@pytest.fixture(scope="module")
def world() -> Iterator[SmallWorld]:
    small = SmallWorld()
    yield small
    small.renderer().close()


@pytest.fixture(scope="module")
def drive() -> Timeline:
    """One second at 10 m/s to the east behind a car of the same speed; the light is red, then green."""
    ticks = np.arange(221) * 0.005
    position = np.stack([SPEED_MPS * ticks, 0 * ticks, 0 * ticks], axis=-1)
    track = EgoTrack.from_arrays(position, np.tile([0.0, 0.0, 0.0, 1.0], (len(ticks), 1)))
    catalog = replace(Scenery.catalog(["saloon"]), id=np.array([EGO_INSTANCE + 9], np.uint32))
    timeline = Timeline(catalog, ego=track)
    for step in range(22):
        timeline.append_step(
            Scenery.frame([[ACTOR_AHEAD_M + 0.5 * step, 0, 0]], speed_mps=SPEED_MPS),
            np.array([1 if step < 10 else 3], np.uint8),
        )
    return timeline


def camera(world: SmallWorld, **settings: object) -> CameraSensor:
    mount = Mount(position_m=(1.8, 0.2, 1.6), axes="optical")
    settings = {"name": "left", "mount": mount, "pinhole": PINHOLE, **settings}
    return CameraConfig(**settings).build(world)  # type: ignore[arg-type]


def test_streams_match_the_samples(world: SmallWorld, drive: Timeline) -> None:
    sensor = camera(world)
    samples = sensor.measure(drive, [100_000_000])
    assert [sample.sensor for sample in samples] == ["rgb_left", "depth_left", "semantic_left"]
    assert [type(sample) for sample in samples] == [Image, DepthImage, SemanticImage]
    assert {sample.frame_id for sample in samples} == {"camera_left"}
    rgb, depth, semantic = samples
    for space, value in zip(sensor.streams().values(), (rgb.rgb, depth.depth_m, semantic.tag), strict=True):  # type: ignore[attr-defined]
        assert space.contains(value)


def test_outputs_choose_the_streams(world: SmallWorld, drive: Timeline) -> None:
    sensor = camera(world, outputs=("semantic",))
    assert list(sensor.streams()) == ["semantic_left"]
    assert [sample.sensor for sample in sensor.measure(drive, [0])] == ["semantic_left"]


@pytest.mark.parametrize("stamp_ns", [25_000_000, 50_000_000, 115_000_000, 700_000_000])
def test_depth_of_the_leading_car_at_any_stamp(world: SmallWorld, drive: Timeline, stamp_ns: int) -> None:
    """Ego and leader move alike, so the gap never changes, between the steps neither."""
    samples = camera(world, outputs=("depth", "semantic")).measure(drive, [stamp_ns])
    depth, semantic = samples[0].depth_m, samples[1]  # type: ignore[attr-defined]
    expected = ACTOR_AHEAD_M - 2.3 - 1.8
    row, column = 100, 160
    assert semantic.instance[row, column] == EGO_INSTANCE + 9  # type: ignore[attr-defined]
    assert depth[row, column] == pytest.approx(expected, abs=0.002)


def test_bonnet_shows_at_the_bottom(world: SmallWorld, drive: Timeline) -> None:
    semantic = camera(world, outputs=("semantic",)).measure(drive, [0])[0]
    assert semantic.instance[-1, 150] == EGO_INSTANCE  # type: ignore[attr-defined]


def test_lit_lens_follows_the_signal(world: SmallWorld, drive: Timeline) -> None:
    """The lens stands 30 m ahead at the start, 4 m left and up; green has no lens in this world."""
    sensor = camera(world, outputs=("semantic",))
    red = sensor.measure(drive, [0])[0].instance  # type: ignore[attr-defined]
    green = sensor.measure(drive, [600_000_000])[0].instance  # type: ignore[attr-defined]
    rows, columns = np.nonzero(red == 55)
    ((u, v),) = PINHOLE.project([[0.2 - 4.0, 1.6 - 4.0, 30.0 - 1.8 - 0.02]])
    assert abs(columns.mean() - u) < 1.0
    assert abs(rows.mean() - v) < 1.0
    assert not np.any(green == 55)
