"""What weather does to the keypoints of a visual SLAM system, along the routes of towns."""

import numpy as np
import pytest
from shared_fixtures.readings.orb_features import CHOICES, Features, Found, found
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.map.sources import known_towns
from carlaloc_env.weather.presets import PRESETS

need_opengl()


def read(town: str, features: Features) -> None:
    """Print what was found; how many keypoints a street bears is for reading, not a bar."""
    for key, of in features.figures.items():
        numbers = (f"{name} {getattr(of, name):.3g}" for name in Found.__slots__)
        print(town, *key, *numbers)  # noqa: T201
    print(town, f"fog_reach_m {features.fog_reach_m:.3g}")  # noqa: T201


def judge(features: Features) -> None:
    """What weather must do to a SLAM system: fog hides what is far, night blurs and grains.

    How far one sees in fog is a matter of the fog. Against what one sees in clear air, it would be one of
    the houses: matches lie 13 to 17 m away in the fog of all towns, but at noon 26 m in the narrow streets
    of Town01 and 85 m on the motorway of Town04.
    """
    figures = features.figures
    for choice in CHOICES:
        clear, night = figures["ClearNoon", choice], figures["RainyNight", choice]
        assert night.matches < clear.matches
        assert night.error_px > clear.error_px
        assert figures["FoggyNoon", choice].matches < clear.matches
    fog = figures["FoggyNoon", "strongest"]
    assert fog.reach_m <= features.fog_reach_m
    assert fog.depth_m <= np.log(2.0) / PRESETS["FoggyNoon"].extinction_per_m


@pytest.mark.soak
@pytest.mark.parametrize("town", known_towns())
def test_orb_in_every_town(town: str) -> None:
    features = found(town, 50)
    read(town, features)
    judge(features)
