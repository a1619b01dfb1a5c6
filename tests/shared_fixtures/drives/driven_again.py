"""A drive simulated again from its recorded controls."""

from contextlib import closing
from pathlib import Path

from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.task.episode_start import route_again
from carlaloc_env.traffic.population import TrafficConfig
from recorder.drive.episode_listener import FIRST_DRIVEN_TICK, EpisodeListener
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.episode.writer import EpisodeWriter


def assert_same_again(source: Path, map: Path | None = None) -> None:
    """The controls of an episode lead to the same bytes of ego, traffic and lights."""
    episode = Episode.load(source)
    header, out = episode.header, source.with_name(f"{source.stem}_again.mcap")
    traffic = from_mapping(TrafficConfig, header.traffic, "traffic")
    listener = EpisodeListener(lambda _: EpisodeWriter(out, header))
    town = town_of(episode, map)
    with closing(DrivingWorld(town, traffic, ride=header.ride)) as world:
        world.reset(header.seed, listener, route=route_again(header.route, town))
        for tick in range(FIRST_DRIVEN_TICK, len(episode.ego)):
            listener.raw = episode.raw_controls.at(tick)
            world.tick(episode.controls.at(tick))
    listener.writer.close()
    again = Episode.load(out)
    assert again.ego.tobytes() == episode.ego.tobytes()
    assert again.steps.tobytes() == episode.steps.tobytes()
