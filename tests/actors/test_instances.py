"""Everything that moves at one instant, as models."""

from dataclasses import replace

import numpy as np
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.actors.instances import instances_at
from carlaloc_env.core.transforms import from_rotation
from carlaloc_env.scene.mesh import EGO_INSTANCE, ModelLibrary
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.timeline.actors import LIGHT_BRAKE
from carlaloc_env.timeline.snapshot import Snapshot

ACTOR = EGO_INSTANCE + 7


def instant() -> tuple[Snapshot, SignalLenses]:
    """The ego brakes; a saloon 10 m before it brakes too; one of two lenses is lit."""
    catalog = replace(Scenery.catalog(["saloon"]), id=np.array([ACTOR], np.uint32))
    actors = Scenery.frame([[110.0, 50.0, 0.0]], lights=LIGHT_BRAKE)
    snapshot = Snapshot(
        stamp_ns=0,
        T_world_base=from_rotation(np.eye(3), (100.0, 50.0, 0.0)),
        ego_lights=LIGHT_BRAKE,
        catalog=catalog,
        actors=actors,
        signals=np.array([1], np.uint8),
    )
    lenses = SignalLenses(
        signal=np.array([0, 0], np.int32),
        state=np.array([1, 3], np.uint8),
        T_world_lens=np.stack([np.eye(4)] * 2),
    )
    return snapshot, lenses


def test_everything_that_moves_or_shines_is_there(library: ModelLibrary) -> None:
    """Ego, saloon with four wheels and two plates, brake lamps of both, the red lens."""
    snapshot, lenses = instant()
    seen = instances_at(library, lenses, snapshot)
    names = [library.names[m] for m in seen.model]
    assert names[:3] == ["ego", "ego/brake", "saloon/body"]
    assert sum(name.startswith("saloon/wheel") for name in names) == 4
    assert names[-2:] == ["saloon/brake", "signal_red"]
    assert set(seen.instance[:2].tolist()) == {EGO_INSTANCE}
    of_saloon = np.array([name.startswith(("saloon", "plate")) for name in names])
    assert set(seen.instance[of_saloon].tolist()) == {ACTOR}
    np.testing.assert_allclose(seen.T_world_model[:2, :3, 3], [[100.0, 50.0, 0.0]] * 2)
    away = seen.T_world_model[of_saloon][:, :3, 3] - [110.0, 50.0, 0.0]
    assert np.abs(away).max() < 3.0


def test_headlamps_go_out_by_another_id(library: ModelLibrary) -> None:
    """All else stays: the renderer gives low beams to the ego's own id only."""
    snapshot, lenses = instant()
    lit = instances_at(library, lenses, snapshot)
    dark = instances_at(library, lenses, replace(snapshot, ego_headlamps=False))
    assert EGO_INSTANCE not in dark.instance
    assert np.array_equal(lit.model, dark.model)
    assert np.array_equal(lit.instance[2:], dark.instance[2:])


def test_detail_goes_by_the_distance_from_the_ego(library: ModelLibrary) -> None:
    snapshot, lenses = instant()
    far = replace(snapshot, T_world_base=from_rotation(np.eye(3), (0.0, 50.0, 0.0)))
    names = {library.names[m] for m in instances_at(library, lenses, far).model}
    assert {"saloon/low", "saloon/low/brake"} <= names
    assert not any(name.startswith("saloon/wheel") for name in names)
