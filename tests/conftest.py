"""What all tests share, which are long, and their order: long ones first, so that no process ends alone."""

import signal

import hypothesis
import pytest

# Seconds of the clock are no fault of a test: another process may hold every core.
hypothesis.settings.register_profile(
    "tests", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("tests")

pytest_plugins = [
    "shared_fixtures.worlds.scenes",
    "shared_fixtures.drives.sticks",
    "shared_fixtures.drives.straight_drives",
    "shared_fixtures.drives.drives",
    "shared_fixtures.processes.lifecycles",
    "shared_fixtures.worlds.meshes",
    "shared_fixtures.worlds.small_towns",
    "shared_fixtures.worlds.towns",
]

LONG = tuple(
    f"tests/{place}"
    for place in (
        *("whole/", "streaming/", "replaying/", "envs/", "benchmark/", "bad_input/", "window/", "drive/"),
        *("sweep/", "breaking/", "closed_loop/", "places/", "consistency/", "map_truth/test_map_commands.py"),
        *("demo/", "factory/", "verification/", "writers/test_full_disks.py", "cli/test_closed_pipe.py"),
        *("render/lighting/test_sunlit_lanes.py", "rigs/test_industrial_camera.py"),
        *("map/opendrive/test_crossfall.py", "town/test_build.py", "traffic/test_whole_towns.py"),
        *("devices/scripted/test_hand.py", "view/test_scene_page.py", "report/test_town_list.py"),
        *("traffic/test_traffic_near_ego.py", "render/test_steady_pictures.py"),
        *("map/lanes/test_network_carla.py", "writers/formats/test_colmap.py", "slam/test_evalio_dataset.py"),
        *("slam/test_evalio_points.py", "evaluation/test_long_tum.py", "publishing/"),
        "slam/test_program_instants.py",
        *("slam/test_keeper.py", "slam/test_external_programs.py", "slam/test_ros1_play.py"),
        *("writers/ros/test_ros_tools.py", "core/test_jit.py"),
    )
)
"""Where tests start processes, replays, environments or windows, or need other programs or the group `peers`.

`make test` leaves these places out, `make test-long` runs them.
"""
FIRST = tuple(f"tests/whole/test_{module}.py" for module in ("journey", "live_and_replayed"))
"""Modules there that go through the whole, and so break first: `make test` runs them."""


def pytest_configure() -> None:
    """Let Ctrl-C end what tests start: background commands of a plain shell are born ignoring it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark the tests of long places; single tests elsewhere have the mark in their module."""
    if item.nodeid.startswith(LONG) and not item.nodeid.startswith(FIRST):
        item.add_marker("long")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put modules of long tests before all others; modules stay together."""

    def rank(item: pytest.Item) -> int:
        return next((n for n, folder in enumerate(LONG) if item.nodeid.startswith(folder)), len(LONG))

    items.sort(key=rank)
