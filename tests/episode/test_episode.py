"""Episode files: bit-exact, and readable by other MCAP tools."""

import io
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from shared_fixtures.drives.episodes import SIGNALS, catalog_of, frame_of, header_of, row_of, write_drive

from carlaloc_env.core.ego import EGO_FRONT_M
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.timeline.timeline import Timeline
from recorder.episode.episode import Episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.mcap_container import ContainerWriter
from recorder.episode.record_types import RecordType
from recorder.episode.summary import summarise
from recorder.episode.writer import EpisodeWriter


@pytest.mark.parametrize("count", [0, 1, 5])
def test_round_trip_is_bit_exact(tmp_path: Path, count: int) -> None:
    path = tmp_path / "drive.mcap"
    with EpisodeWriter(path, header_of(count)) as writer:
        write_drive(writer, 471, count)
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["drive.mcap"]
    episode = Episode.load(path)
    assert episode.complete
    assert episode.duration_s == pytest.approx(2.35)
    assert episode.last_good_ns == 2_350_000_000
    live = Timeline(catalog_of(count))
    for tick in range(471):
        row = row_of(tick)
        live.ego.append(row.position_m, row.quat_xyzw)
        assert row.raw is not None
        assert episode.controls.at(tick) == row.controls
        assert episode.raw_controls.at(tick) == row.raw
        if tick % 10 == 0:
            live.append_step(frame_of(tick // 10, count), np.full(SIGNALS, tick // 10 % 4, dtype=np.uint8))
    timeline = episode.timeline()
    assert timeline.end_ns == live.end_ns
    assert timeline.ego.position_m.tobytes() == live.ego.position_m.tobytes()
    assert timeline.ego.quat_xyzw.tobytes() == live.ego.quat_xyzw.tobytes()
    for stamp in range(0, live.end_ns, 37_000_000):
        ours, theirs = timeline.actors_at(stamp), live.actors_at(stamp)
        for name in ActorFrame.__slots__:
            assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes()
            assert getattr(ours, name).dtype == getattr(theirs, name).dtype
        assert timeline.signals_at(stamp).tolist() == live.signals_at(stamp).tolist()
    assert episode.events[0].data == {"with": "ü-car", "impulse_ns": 1.5}
    assert (episode.events[0].kind, episode.events[0].tick) == ("collision", 33)


def test_header_round_trip(tmp_path: Path) -> None:
    with EpisodeWriter(tmp_path / "a.mcap", header_of(3)) as writer:
        write_drive(writer, 2, 3)
    ours, theirs = Episode.load(tmp_path / "a.mcap").header, header_of(3)
    for name in EpisodeHeader.__slots__:
        if name != "catalog":
            assert getattr(ours, name) == getattr(theirs, name), name
    assert ours.catalog.model == theirs.catalog.model
    for name in ("id", "tag", "size_m", "tint"):
        assert getattr(ours.catalog, name).tobytes() == getattr(theirs.catalog, name).tobytes()


def test_mcap_library_reads_the_file(tmp_path: Path) -> None:
    with EpisodeWriter(tmp_path / "a.mcap", header_of(2)) as writer:
        write_drive(writer, 600, 2)
    reader = make_reader(io.BytesIO((tmp_path / "a.mcap").read_bytes()), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 600 + 60 + 1
    assert len(summary.chunk_indexes) >= 3
    ticks = 0
    for schema, channel, message in reader.iter_messages(topics=["/ego/state"]):
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        assert message.log_time == ticks * 5_000_000
        ticks += 1
    assert ticks == 600
    assert [m.name for m in reader.iter_metadata()] == ["carlaloc_episode"]


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"PNG" * 100)
    with pytest.raises(EpisodeError, match="not an MCAP file"):
        Episode.load(tmp_path / "a.mcap")
    with pytest.raises(EpisodeError, match="cannot read"):
        Episode.load(tmp_path / "missing.mcap")
    other = ContainerWriter(tmp_path / "b.mcap")
    other.add_channel(RecordType(topic="/x", name="std_msgs/msg/Bool", definition="bool data\n"))
    other.finish()
    with pytest.raises(EpisodeError, match="no header"):
        Episode.load(tmp_path / "b.mcap")


@pytest.mark.parametrize(("device", "judged"), [("scripted", False), ("keyboard", None), ("mine", None)])
def test_only_the_scripted_driver_is_held_to_the_papers_length(
    device: str, judged: bool | None, tmp_path: Path
) -> None:
    """A person may take a detour; the table's length stays in the summary."""
    header = EpisodeHeader(map_name="Town03", device=device, route={"table_length_m": 970.0})
    with EpisodeWriter(tmp_path / "a.mcap", header) as writer:
        write_drive(writer, 11, 0)
    summary = summarise(Episode.load(tmp_path / "a.mcap"))
    assert (summary.meets_table, summary.table_length_m) == (judged, 970.0)


def test_a_summary_tells_stops_and_who_is_close_ahead(tmp_path: Path) -> None:
    """Ten seconds northwards: 2 s at rest, 4 s of driving, 1 s of standing, a crawl that is none, driving on.

    A car is 8 m before the bumper for 3 s, then in the next lane; another is on a bridge above.
    """
    path, catalog = tmp_path / "stops.mcap", catalog_of(2)
    length_m = float(catalog.size_m[0, 0])
    with EpisodeWriter(path, EpisodeHeader(map_name="Town03", catalog=catalog)) as writer:
        for tick in range(2001):
            at_s = tick / 200.0
            speed = (
                0.0
                if at_s < 2.0
                else 8.0
                if at_s < 6.0
                else 0.0
                if at_s < 7.0
                else 0.5
                if at_s < 8.0
                else 8.0
            )
            speed = 0.1 if 7.4 < at_s < 7.6 else speed
            turn = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
            here = np.array([100.0, 20.0 + at_s, 1.0])
            row = row_of(tick)._replace(position_m=here, quat_xyzw=turn, speed_mps=speed)
            writer.ego(tick, row)
            if tick % 10 == 0:
                frame = frame_of(tick // 10, 2)
                ahead_m = EGO_FRONT_M + 8.0 + 0.5 * length_m
                frame.position_m[0] = here + np.array([0.0 if at_s < 3.0 else 3.5, ahead_m, 0.0])
                frame.position_m[1] = here + np.array([0.0, ahead_m, 6.0])
                frame.heading_rad[:] = np.pi / 2
                writer.step(tick // 10, frame, np.zeros(SIGNALS, np.uint8))
    found = summarise(Episode.load(path))
    assert found.standing == pytest.approx(0.32, abs=0.002)
    assert found.stops == 1
    assert found.mover_close_s == pytest.approx(3.0, abs=0.051)
