"""Episode files: bit-exact, readable by other MCAP tools, and never lost."""

from __future__ import annotations

import errno
import io
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from carlaloc_env.core.controls import Controls
from carlaloc_env.core.errors import EpisodeError, OutputError
from carlaloc_env.timeline.actor_quantisation import on_grid
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame, Timeline
from recorder.episode import actor_messages, messages
from recorder.episode.episode import EgoRow, Episode, EpisodeHeader, EpisodeWriter, open_episode
from recorder.episode.mcap_container import ContainerWriter
from recorder.episode.repair import repair_episode

SIGNALS = 7


def catalog_of(count: int) -> ActorCatalog:
    rng = np.random.default_rng(count)
    return ActorCatalog(
        id=np.arange(1 << 23, (1 << 23) + count, dtype=np.uint32),
        model=tuple(f"modèle_{k}" for k in range(count)),
        tag=rng.integers(0, 29, count, dtype=np.uint8),
        size_m=rng.random((count, 3), dtype=np.float32),
        tint=rng.integers(0, 256, (count, 3), dtype=np.uint8),
    )


def header_of(count: int) -> EpisodeHeader:
    return EpisodeHeader(
        map_name="Town03",
        map_hash="ab12",
        seed=7,
        catalog=catalog_of(count),
        route={"points": [[0.1, 2.0]], "loop": True},
        rig="paper",
        traffic={"vehicles": count},
        weather="ClearNoon",
        device="scripted",
        versions={"pybullet": "3.2.7"},
        history=("cut 0–5 s",),
    )


def frame_of(step: int, count: int) -> ActorFrame:
    rng = np.random.default_rng(1000 + step)
    frame = ActorFrame(
        position_m=rng.normal(0, 100, (count, 3)).astype(np.float32),
        heading_rad=rng.normal(size=count).astype(np.float32),
        pitch_rad=rng.normal(size=count).astype(np.float32),
        roll_rad=rng.normal(size=count).astype(np.float32),
        speed_mps=rng.normal(size=count).astype(np.float32),
        travelled_m=rng.normal(size=count).astype(np.float32),
        steer_rad=rng.normal(size=count).astype(np.float32),
        lights=rng.integers(0, 32, count, dtype=np.uint8),
    )
    return on_grid(frame)


def row_of(tick: int) -> EgoRow:
    rng = np.random.default_rng(tick)
    quat = rng.normal(size=4)
    return EgoRow(
        position_m=rng.normal(0, 300, 3),
        quat_xyzw=quat / np.linalg.norm(quat),
        velocity_world_mps=rng.normal(0, 9, 3),
        omega_body_radps=rng.normal(size=3),
        controls=Controls(
            steer=float(rng.uniform(-1, 1)), throttle=float(rng.random()), reverse=tick % 3 == 0
        ),
        raw=Controls(steer=float(rng.uniform(-1, 1)), brake=float(rng.random()), handbrake=tick % 2 == 0),
        road_wheel_rad=float(rng.normal()),
        speed_mps=float(rng.normal()),
    )


def write(writer: EpisodeWriter, ticks: int, count: int) -> None:
    for tick in range(ticks):
        if tick % 10 == 0:
            signals = np.full(SIGNALS, tick // 10 % 4, dtype=np.uint8)
            writer.step(tick // 10, frame_of(tick // 10, count), signals)
        if tick == 33:
            writer.event(tick, "collision", {"with": "ü-car", "impulse_ns": 1.5})
        writer.ego(tick, row_of(tick))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_round_trip_is_bit_exact(tmp_path: Path, count: int) -> None:
    path = tmp_path / "drive.mcap"
    with EpisodeWriter(path, header_of(count)) as writer:
        write(writer, 471, count)
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
        write(writer, 2, 3)
    ours, theirs = Episode.load(tmp_path / "a.mcap").header, header_of(3)
    for name in EpisodeHeader.__slots__:
        if name != "catalog":
            assert getattr(ours, name) == getattr(theirs, name), name
    assert ours.catalog.model == theirs.catalog.model
    for name in ("id", "tag", "size_m", "tint"):
        assert getattr(ours.catalog, name).tobytes() == getattr(theirs.catalog, name).tobytes()


def test_bytes_equal_those_of_another_cdr_implementation() -> None:
    """Rules out a file that only we can read: rosbags must produce the same bytes."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (
        (messages.EGO_TYPE, messages.EGO_DEFINITION),
        (actor_messages.ACTORS_TYPE, actor_messages.ACTORS_DEFINITION),
        (messages.EVENT_TYPE, messages.EVENT_DEFINITION),
    ):
        store.register(get_types_from_msg(text, name))
    row = row_of(5)
    ego = store.deserialize_cdr(messages.pack_ego(5, row), messages.EGO_TYPE)
    assert ego.tick == 5  # type: ignore[attr-defined]
    assert ego.quat_xyzw.tolist() == np.asarray(row.quat_xyzw).tolist()  # type: ignore[attr-defined]
    assert bytes(store.serialize_cdr(ego, messages.EGO_TYPE)) == messages.pack_ego(5, row)
    for count in range(6):
        ours = actor_messages.pack_actors(9, frame_of(9, count), np.arange(SIGNALS, dtype=np.uint8))
        frame = store.deserialize_cdr(ours, actor_messages.ACTORS_TYPE)
        assert frame.signals.tolist() == list(range(SIGNALS))  # type: ignore[attr-defined]
        assert bytes(store.serialize_cdr(frame, actor_messages.ACTORS_TYPE)) == ours
    for kind in ("a", "ab", "abc", "abcd"):
        ours = messages.pack_event(3, kind, '{"x": 1}')
        event = store.deserialize_cdr(ours, messages.EVENT_TYPE)
        assert (event.kind, event.json) == (kind, '{"x": 1}')  # type: ignore[attr-defined]
        assert bytes(store.serialize_cdr(event, messages.EVENT_TYPE)) == ours


def test_mcap_library_reads_the_file(tmp_path: Path) -> None:
    with EpisodeWriter(tmp_path / "a.mcap", header_of(2)) as writer:
        write(writer, 600, 2)
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


_CHILD = """
import sys, time, numpy as np
from recorder.episode.episode import EpisodeWriter, EpisodeHeader, EgoRow
from carlaloc_env.timeline.timeline import empty_frame
with EpisodeWriter(sys.argv[1], EpisodeHeader(map_name="Town03")) as w:
    for tick in range(10**7):
        if tick % 10 == 0:
            w.step(tick // 10, empty_frame(), np.zeros(3, np.uint8))
        w.ego(tick, EgoRow(position_m=(tick, 0.5, 0.0), quat_xyzw=(0, 0, 0, 1)))
        if tick % 10 == 0:
            print(tick, flush=True)
        time.sleep(float(sys.argv[2]))
"""


def test_killed_recordings_are_readable_up_to_the_last_second(tmp_path: Path) -> None:
    """SIGKILL at random moments, at full speed and at real time (there the wall clock flushes)."""
    rng = random.Random(1)
    for trial in range(6):
        path = tmp_path / f"{trial}.mcap"
        child = subprocess.Popen(
            [sys.executable, "-c", _CHILD, str(path), "0.0" if trial % 2 else "0.004"],
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
        )
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(rng.uniform(0.0, 1.6))
        os.kill(child.pid, signal.SIGKILL)
        rest, _ = child.communicate()
        printed = [int(line) for line in rest.splitlines() if line]
        reached = printed[-2] if len(printed) > 1 else 0
        assert not path.exists()
        episode = open_episode(path)
        assert not episode.complete
        assert len(episode.ego) >= reached - 200
        assert np.array_equal(episode.ego["position_m"][:, 0], np.arange(len(episode.ego)))
        with pytest.raises(EpisodeError, match=r"last good time \d+\.\d{3} s"):
            Episode.load(path)
        whole = repair_episode(path)
        assert whole.path == path
        assert whole.complete
        assert whole.ego.tobytes() == episode.ego.tobytes()


def test_file_cut_or_damaged_anywhere_is_never_misread(tmp_path: Path) -> None:
    """Every prefix and every flipped byte gives the true beginning of the drive or a named error."""
    path = tmp_path / "a.mcap"
    with EpisodeWriter(path, header_of(2)) as writer:
        write(writer, 500, 2)
    data = path.read_bytes()
    truth = Episode.load(path).ego
    rng = random.Random(2)
    survivors = 0
    for _ in range(150):
        broken = bytearray(data[: rng.randrange(len(data))] if rng.random() < 0.5 else data)
        if len(broken) == len(data):
            broken[rng.randrange(len(data) // 2)] ^= 1 << rng.randrange(8)
        (tmp_path / "b.mcap").write_bytes(broken)
        try:
            episode = open_episode(tmp_path / "b.mcap")
        except EpisodeError:
            continue
        survivors += 1
        assert episode.ego.tobytes() == truth[: len(episode.ego)].tobytes()
        assert episode.header.to_metadata() == header_of(2).to_metadata()
    assert survivors > 30


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"PNG" * 100)
    with pytest.raises(EpisodeError, match="not an MCAP file"):
        Episode.load(tmp_path / "a.mcap")
    with pytest.raises(EpisodeError, match="cannot read"):
        Episode.load(tmp_path / "missing.mcap")
    other = ContainerWriter(tmp_path / "b.mcap")
    other.add_channel("/x", "std_msgs/msg/Bool", "bool data\n")
    other.finish()
    with pytest.raises(EpisodeError, match="no header"):
        Episode.load(tmp_path / "b.mcap")


def test_existing_names_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with EpisodeWriter(path, header_of(0)) as writer:
        write(writer, 3, 0)
        for overwrite in (False, True):
            with pytest.raises(OutputError, match=r"carlaloc info --repair .*a\.mcap\.recording"):
                EpisodeWriter(path, header_of(0), overwrite=overwrite)
    with pytest.raises(OutputError, match="move it away"):
        EpisodeWriter(path, header_of(0))
    with EpisodeWriter(path, header_of(0), overwrite=True) as writer:
        write(writer, 5, 0)
        assert len(Episode.load(path).ego) == 3
    assert len(Episode.load(path).ego) == 5


def test_exception_keeps_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"

    def crash() -> None:
        with EpisodeWriter(path, header_of(0)) as writer:
            write(writer, 42, 0)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        crash()
    assert not path.exists()
    assert len(open_episode(path).ego) == 42


def test_gaps_are_refused(tmp_path: Path) -> None:
    with EpisodeWriter(tmp_path / "a.mcap", header_of(1)) as writer:
        with pytest.raises(EpisodeError, match="tick 1 recorded where 0"):
            writer.ego(1, row_of(1))
        with pytest.raises(EpisodeError, match="step 2 recorded where 0"):
            writer.step(2, frame_of(2, 1), np.zeros(1, np.uint8))
        with pytest.raises(EpisodeError, match="2 actors"):
            writer.step(0, frame_of(0, 2), np.zeros(1, np.uint8))


class _NearlyFullDisk:
    """A file that takes half of the next write and then has no space."""

    def __init__(self, file: io.FileIO) -> None:
        self._file = file
        self._full = False

    def write(self, data: memoryview) -> int:
        if self._full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._full = True
        return self._file.write(data[: len(data) // 2])

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


def test_full_disk_is_a_named_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    writer = EpisodeWriter(path, header_of(0))
    write(writer, 250, 0)
    monkeypatch.setattr(writer._file, "_file", _NearlyFullDisk(writer._file._file))

    def drive_on() -> None:
        for tick in range(250, 1000):
            writer.ego(tick, row_of(tick))

    with pytest.raises(EpisodeError, match="No space left"):
        drive_on()
    episode = open_episode(path)
    assert episode.problem == "the file was not closed"
    assert len(episode.ego) >= 180
