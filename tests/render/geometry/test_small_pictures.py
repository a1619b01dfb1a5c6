"""Levels of detail of small live pictures: nothing is lost where levels meet, and pictures look alike."""

import numpy as np
import pytest
from shared_fixtures.worlds.render_scenes import need_opengl, scene, standing
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.render.geometry.distant_models import Distant, levels
from carlaloc_env.render.geometry.level_of_detail import FAR_LOW, coarse
from carlaloc_env.render.geometry.static_scene import _cells
from carlaloc_env.render.lighting import shadow_maps
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Instances, Mesh, ModelLibrary, make_mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.presets import PRESETS

SMALL = Pinhole.from_fov(84, 84, 90.0)


def field(size_m: float = 120.0, step_m: float = 1.5) -> Mesh:
    """Level ground in many triangles, with a block every fifteen metres."""
    count = int(size_m / step_m) + 1
    x, y = np.meshgrid(np.arange(count) * step_m, np.arange(count) * step_m - size_m / 2, indexing="ij")
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    quads = np.stack([corner, corner + count, corner + count + 1, corner + 1], axis=1)
    return make_mesh(
        np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3),
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        material=Material.ASPHALT,
        tag=Tag.ROAD,
    )


def test_each_triangle_of_a_coarser_level_keeps_the_cell_of_the_one_it_was_made_of() -> None:
    """By its corners, which move by less than two cells of the grid; every cell is in one square."""
    whole = field()
    (cell,), squares = _cells([whole], 20.0)
    middle = whole.vertices_m[whole.triangles].mean(axis=1)[:, :2]
    np.testing.assert_array_equal(squares[cell], np.floor(middle / 20.0))
    for how in FAR_LOW[3:6]:
        far, made_of = coarse(whole, how)
        assert len(far.triangles) == len(made_of) < len(whole.triangles)
        moved = far.vertices_m[far.triangles] - whole.vertices_m[whole.triangles[made_of]]
        assert np.abs(moved).max() < how.ground_m
    (one,), _ = _cells([whole], np.inf)
    assert one.max() <= 3, "without an edge a chunk is cut by the axes at most"


def test_no_hole_opens_where_levels_meet() -> None:
    """Ground under a low camera in many places: as much of the small picture shows it as of a large one."""
    need_opengl()
    poses = [
        transforms.from_rotation(transforms.R_FLU_OPTICAL, (3.0 + 1.7 * k, 2.3 * k - 9.0, 1.6))
        for k in range(8)
    ]
    with scene(field(), quality="low") as renderer:
        shown = [renderer.draw(SMALL, pose, Instances()).labels()[0] for pose in poses]
    with scene(field(), quality="medium") as renderer:
        wanted = [renderer.draw(SMALL, pose, Instances()).labels()[0] for pose in poses]
    differ = np.mean(np.array(shown) != np.array(wanted))
    assert differ < 0.01


def test_cars_lose_their_parts_together_and_lamps_of_the_town_stay() -> None:
    """A car's wheels and lamps are judged by its body; signals have no family and are always drawn."""
    box = Scenery.box((-2.0, -0.8, 0.0), (2.0, 0.8, 1.5))
    many = make_mesh(
        np.tile(box.vertices_m, (20, 1)),
        np.concatenate([box.triangles + 8 * k for k in range(20)]),
        material=Material.CAR_PAINT,
        tag=Tag.CAR,
    )
    models = {
        "car": many, "car/body": many, "car/low": many, "car/wheel0": box, "car/brake": box,
        "car/low/brake": box, "signal_red": box,
    }  # fmt: skip
    library = ModelLibrary(models)
    distant = Distant(library)
    index = library.index
    everything = Instances(
        model=np.arange(len(models), dtype=np.int32),
        T_world_model=np.tile(np.eye(4), (len(models), 1, 1)),
        instance=np.zeros(len(models), np.uint32),
        tint=np.zeros((len(models), 3), np.uint8),
    )
    np.testing.assert_array_equal(levels(np.array([0.5, 1.0, 7.9, 8.0, 119.0, 120.0])), [3, 2, 2, 1, 1, 0])
    assert len(distant.of(everything, 0).model) == len(models)
    simple = distant.of(everything, 1).model.tolist()
    assert not {index("car/wheel0"), index("car/body")} & set(simple)
    assert simple.count(index("car/low")) == simple.count(index("car/low/brake")) == 2
    assert distant.simplified == [(index("car/low"), 12)]
    assert distant.of(everything, 2).model.tolist().count(len(library)) == 2
    assert distant.of(everything, 3).model.tolist() == [index("signal_red")]
    assert [distant.measured[index(f"car/{part}")] for part in ("wheel0", "brake")] == [index("car/body")] * 2


@pytest.mark.parametrize("weather", ["ClearNoon", "ClearSunset"])
def test_shadows_that_are_left_out_would_not_be_seen(weather: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Boxes all round the camera: the picture with all shadows has the same bytes."""
    need_opengl()
    library = ModelLibrary({"box": Scenery.box((-0.9, -0.9, 0.0), (0.9, 0.9, 1.8))})
    places = np.random.default_rng(4).uniform((-25.0, -25.0, 0.0), (25.0, 25.0, 0.0), (60, 3))
    places[:, 0] += 40.0
    boxes = Instances.joined(
        [standing(transforms.from_rotation(np.eye(3), place), instance=0, tint=255) for place in places]
    )
    pose = transforms.from_rotation(transforms.R_FLU_OPTICAL, (40.0, 0.0, 1.6))
    left_out = []
    may_shade = shadow_maps._may_shade

    def counting(*given: object) -> object:
        found = may_shade(*given)  # type: ignore[arg-type]
        left_out.append(np.count_nonzero(~found))
        return found

    pictures = []
    for rule in (counting, lambda view, sun, centre, reach: np.ones(len(centre), bool)):
        monkeypatch.setattr(shadow_maps, "_may_shade", rule)
        with scene(field(), library=library, quality="low") as renderer:
            gbuffer = renderer.draw(SMALL, pose, boxes)
            pictures.append(renderer.shade(gbuffer, PRESETS[weather]))
    np.testing.assert_array_equal(*pictures)
    assert left_out[0] > 10
