"""The collision world: actors, walls, repeatability, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.processes.lifecycles import growth
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.physics.bullet import pybullet
from carlaloc_env.physics.ego import EgoCar
from carlaloc_env.physics.ground_heights import ground_table, highest_below
from carlaloc_env.physics.world import PhysicsWorld
from carlaloc_env.timeline.actors import (
    ActorCatalog,
    ActorFrame,
    empty_catalog,
    empty_frame,
)

SQUARE = (
    np.array([[-100.0, -100, 0], [300, -100, 0], [300, 100, 0], [-100, 100, 0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


def with_wall(x_m: float) -> tuple[Array, NDArray[np.int64]]:
    """The square with a wall across."""
    corners = [[x_m, -20.0, -1.0], [x_m, 20.0, -1.0], [x_m, 20.0, 3.0], [x_m, -20.0, 3.0]]
    return np.vstack([SQUARE[0], corners]), np.vstack([SQUARE[1], [[4, 5, 6], [4, 6, 7]]])


def cars_at(positions_m: list[tuple[float, float]], speed_mps: float) -> tuple[ActorCatalog, ActorFrame]:
    """Saloons that face east."""
    catalog = Scenery.catalog(("saloon",) * len(positions_m), size_m=[4.5, 1.8, 1.5])
    return catalog, Scenery.frame([(x, y, 0.0) for x, y in positions_m], speed_mps=speed_mps)


def rows_of(car: EgoCar, ticks: int, controls: Controls) -> Array:
    """Poses of some ticks under constant controls."""
    rows = []
    for _ in range(ticks):
        car.tick(controls)
        state = car.state()
        rows.append(np.concatenate([state.position_m, state.quat_xyzw, state.velocity_world_mps]))
    return np.array(rows)


def test_same_bytes_again_and_after_a_crash() -> None:
    """A drive into a wall repeats byte by byte in the same world and in a fresh one."""
    runs = []
    for _ in range(2):
        with PhysicsWorld(*with_wall(40.0)) as world:
            car = EgoCar(world)
            for _ in range(2):
                car.reset((0.0, 0.0, 0.0), 0.02)
                runs.append(rows_of(car, 900, Controls(throttle=0.9, steer=0.02)).tobytes())
                assert world.contacts()
    assert len(set(runs)) == 1


def test_a_wall_stops_the_car() -> None:
    """The body ends before the wall, and the impulse is the momentum lost or more."""
    with PhysicsWorld(*with_wall(40.0)) as world:
        car = EgoCar(world)
        car.reset((0.0, 0.0, 0.0), 0.0)
        assert world.contacts() == []
        rows = rows_of(car, 1200, Controls(throttle=0.9))
        contacts = world.contacts()
        assert [contact.actor_id for contact in contacts] == [None]
        assert rows[:, 0].max() + 3.75 < 40.2
        assert rows[:, 2].max() < 1.0
        assert contacts[0].impulse_ns > 0.9 * car.params.mass_kg * rows[:, 7].max()
        assert abs(contacts[0].position_m[0] - 40.0) < 0.3
        assert world.contacts() == []


def test_hits_a_moving_actor_where_it_is_now() -> None:
    """Actors move between the steps; the one that is touched is named."""
    catalog, frame = cars_at([(30.0, 0.0), (30.0, 9.0), (500.0, 0.0)], speed_mps=4.0)
    with PhysicsWorld(*SQUARE) as world:
        car = EgoCar(world)
        car.reset((0.0, 0.0, 0.0), 0.0)
        for tick in range(1500):
            if tick % 10 == 0:
                travelled = np.array([4.0 * tick * TICK_S, 0.0, 0.0], np.float32)
                world.set_actors(replace(frame, position_m=frame.position_m + travelled), catalog)
            car.tick(Controls(throttle=0.9))
            found = world.contacts()
            if found:
                break
        assert found[0].actor_id == int(catalog.id[0])
        rear = 30.0 + 4.0 * (tick + 1) * TICK_S - 2.25
        assert car.state().position_m[0] + 3.75 == pytest.approx(rear, abs=0.1)


def test_actors_neither_hold_wheels_nor_stay_after_reset() -> None:
    """A box above the road is no road, and a reset clears the street."""
    catalog, frame = cars_at([(x, 0.0) for x in range(8, 200, 6)], speed_mps=0.0)
    with PhysicsWorld(*SQUARE) as world:
        car = EgoCar(world)
        car.reset((0.0, 0.0, 0.0), 0.0)
        alone = rows_of(car, 500, Controls(throttle=0.9))
        car.reset((0.0, 0.0, 0.0), 0.0)
        world.set_actors(frame, catalog)
        rows_of(car, 500, Controls(throttle=0.9))
        assert {contact.actor_id for contact in world.contacts()} <= {int(i) for i in catalog.id}
        car.reset((0.0, 0.0, 0.0), 0.0)
        world.set_actors(empty_frame(), empty_catalog())
        assert np.array_equal(rows_of(car, 500, Controls(throttle=0.9)), alone)


def test_a_mesh_in_parts_drives_like_one() -> None:
    """More triangles than one PyBullet message carries are split; the road stays the same."""
    axis = np.linspace(-60.0, 60.0, 251)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    k = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    assert len(triangles) > 100_000
    with PhysicsWorld(np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3), triangles) as world:
        car = EgoCar(world)
        car.reset((-50.0, 0.0, 0.0), 0.0)
        rows = rows_of(car, 900, Controls(throttle=0.9))
    assert rows[-1, 0] > -15.0
    assert np.abs(rows[:, 2]).max() < 0.05


def test_bad_places_and_meshes_are_named() -> None:
    with PhysicsWorld(*SQUARE) as world:
        with pytest.raises(ConfigError, match="no road under the ego"):
            EgoCar(world).reset((900.0, 0.0, 0.0), 0.0)
        with pytest.raises(ConfigError, match="friction"):
            world.set_friction(0.0)
        world.close()
    with pytest.raises(ConfigError, match="collision mesh"):
        PhysicsWorld(SQUARE[0], np.zeros((0, 3), np.int64))
    with pytest.raises(ConfigError, match="not finite"):
        PhysicsWorld(SQUARE[0] * np.nan, SQUARE[1])
    with pytest.raises(ConfigError, match="indices"):
        PhysicsWorld(SQUARE[0], SQUARE[1] + 2)


def test_closed_and_dropped_worlds_are_let_go() -> None:
    """PyBullet keeps a mesh's lists for ever, 3 MB here, and a world that nobody disconnects."""
    side = np.arange(101.0)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    vertices = np.stack([x, y, np.sin(x) + np.cos(y)], axis=1)
    corner = np.flatnonzero((x < 100) & (y < 100))
    triangles = np.concatenate([np.stack([corner, corner + 1, corner + far], axis=1) for far in (102, 101)])

    def close(_: int) -> None:
        PhysicsWorld(vertices, triangles).close()

    def drop(_: int) -> None:
        client = PhysicsWorld(vertices, triangles).client
        assert not pybullet.getConnectionInfo(client)["isConnected"]

    for cycle in (close, drop):
        assert growth(cycle, 12, 4).memory_mb < 8 * 0.25


def test_the_mesh_is_where_its_vertices_are() -> None:
    """PyBullet's rays fall to the height of every vertex of a rough mesh; wheels find what they find."""
    side = np.arange(31.0)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    z = np.random.default_rng(0).uniform(-1.0, 1.0, len(x))
    corner = np.flatnonzero((x < 30) & (y < 30))
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + 32], axis=1),
            np.stack([corner, corner + 32, corner + 31], axis=1),
        ]
    )
    with PhysicsWorld(np.stack([x, y, z], axis=1), triangles) as world:
        inside = np.flatnonzero((x % 30 > 0) & (y % 30 > 0))
        anywhere = np.random.default_rng(1).uniform(0.5, 29.5, (400, 2))
        places = np.concatenate([np.stack([x[inside], y[inside]], axis=1), anywhere]).tolist()
        starts = [(a, b, 10.0) for a, b in places]
        hits = pybullet.rayTestBatch(starts, [(a, b, -10.0) for a, b in places], physicsClientId=world.client)
        found = [highest_below(world.ground, a, b, 10.0, -10.0) for a, b in places]
        normals = [world.ground.normal[number] for number, _ in found]
    np.testing.assert_allclose([hit[3][2] for hit in hits[: len(inside)]], z[inside], atol=1e-6)
    np.testing.assert_allclose([height for _, height in found], [hit[3][2] for hit in hits], atol=1e-6)
    np.testing.assert_allclose(normals[len(inside) :], [hit[4] for hit in hits[len(inside) :]], atol=1e-6)


def test_wheels_find_the_road_below_a_bridge_and_on_it() -> None:
    """Of two roads above each other the highest between both ends of a look; nothing where there is none."""
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    vertices = np.concatenate([np.insert(square, 2, height, axis=1) for height in (0.0, 6.0)])
    # The deck's triangles look down, as the underside of a bridge does.
    table = ground_table(vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]))
    assert highest_below(table, 1.0, 2.0, 9.0, -9.0)[1] == 6.0
    assert highest_below(table, 1.0, 2.0, 5.0, -9.0)[1] == 0.0
    assert table.normal[highest_below(table, 1.0, 2.0, 9.0, 1.0)[0]].tolist() == [0.0, 0.0, 1.0]
    for x, y, high_m, low_m in ((1.0, 2.0, 5.0, 1.0), (-1.0, 2.0, 9.0, -9.0), (900.0, 2.0, 9.0, -9.0)):
        assert highest_below(table, x, y, high_m, low_m)[0] == -1


def test_renewed_egos_are_let_go() -> None:
    """PyBullet keeps a removed body's shape, 4 kB of it, so that all egos of a world share theirs."""
    with PhysicsWorld(*SQUARE) as world:
        car = EgoCar(world)
        # A leak grows in each of three rounds; a heap that other tests left in pieces may grow once.
        rounds = [growth(lambda _: car.reset(np.zeros(3), 0.0), 200, 30).memory_mb for _ in range(3)]
    assert min(rounds) < 0.5
