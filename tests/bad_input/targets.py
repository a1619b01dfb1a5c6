"""What reads untrusted input: for each kind a drawer of damaged inputs, and the reader."""

import io
import json
import struct
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import yaml
from bad_input.command_lines import command_lines
from bad_input.mutations import Splices, attributes, damages, elements, lines, spliced, trees
from shared_fixtures.readings.pose_bags import PATH, POSES, TF, Messages
from shared_fixtures.readings.pose_tables import DRESSINGS, S, drive

from carlaloc_env.core.errors import CarlaLocError
from carlaloc_env.map.checks.report import report
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.weather.schedule import weather_of
from recorder.cli.main import main
from recorder.dataset.clouds import cloud_of_fields
from recorder.dataset.scans import read_scans, scans_of
from recorder.dataset.trajectories import read_trajectory
from recorder.episode.actor_messages import ACTORS
from recorder.episode.ego_messages import EGO, EVENT
from recorder.episode.episode import Episode
from recorder.episode.episode_header import _checksum
from recorder.episode.mcap_container import ContainerWriter, read_container
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.trajectory_files import read_tum

try:
    import tomllib
except ModuleNotFoundError:
    import tomli as tomllib

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


class Refused(CarlaLocError):
    """A command ended with an error that it named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seeds:
    """Good files, which are never changed."""

    episode: Path
    """A short drive."""
    bag: Path
    """A bag with a few point clouds on /lidar/points."""
    tum: Path
    """A trajectory."""


Target = tuple[st.SearchStrategy[Any], Callable[[Any], None]]
"""Drawer of inputs, and reader."""


def targets(seeds: Seeds, work: Path) -> dict[str, Callable[[], Target]]:
    """Makers of all targets by name; inputs are written into the folder `work`."""
    return {
        "episode, damaged": lambda: _episode_bytes(seeds, work),
        "episode, forged": lambda: _episode_forged(seeds, work),
        "rig": lambda: _rig(work),
        "weather schedule": lambda: _schedule(work),
        "town.toml": _town_toml,
        "OpenDRIVE map": _map,
        "TUM trajectory": lambda: _tum(seeds, work),
        "table of poses": lambda: _poses(work, "MCD", "bagpy"),
        "KITTI poses": lambda: _poses(work, "a time and a matrix", "KITTI-360"),
        "bag": lambda: _bag(seeds, work),
        "point cloud": _point_cloud,
        "bag of poses": lambda: _pose_bag(seeds, work),
        "command line": lambda: _command_line(seeds, work),
    }


def _read_whole(path: Path) -> None:
    episode = Episode.load(path, allow_partial=True)
    timeline = episode.timeline()
    if timeline.end_ns > 0:
        timeline.actors_at(0)
    episode.controls  # noqa: B018 (a property that unpacks)


def _episode_bytes(seeds: Seeds, work: Path) -> Target:
    path, seed = work / "damaged.mcap", seeds.episode.read_bytes()

    def read(splices: Splices) -> None:
        path.write_bytes(spliced(seed, splices))
        _read_whole(path)

    return damages(seed), read


def _episode_forged(seeds: Seeds, work: Path) -> Target:
    """Episodes whose every checksum is right and whose content is not."""
    good = read_container(seeds.episode.read_bytes())
    (name, header) = good.metadata[0]
    fields = {key: json.loads(text) for key, text in header.items() if key != "crc32"}
    path = work / "forged.mcap"

    def read(drawn: tuple[dict[str, Any], list[tuple[int, int, bytes]]]) -> None:
        values, edits = drawn
        texts = {str(key): json.dumps(value) for key, value in values.items()}
        payloads = {topic: list(rows) for topic, rows in good.payloads.items()}
        for topic_pick, row_pick, put in edits:
            rows = payloads[sorted(payloads)[topic_pick % len(payloads)]]
            at = row_pick % len(rows)
            cut = struct.unpack("<H", (put + b"\0\0")[:2])[0] % (len(rows[at]) + 1)
            rows[at] = rows[at][:cut] + put + rows[at][cut + len(put) :]
        path.unlink(missing_ok=True)
        writer = ContainerWriter(path, durable=False)
        records = {record.topic: record for record in (EGO, ACTORS, EVENT)}
        writer.add_metadata(name, {**texts, "crc32": str(_checksum(texts))})
        for topic, rows in payloads.items():
            channel = writer.add_channel(records[topic])
            for stamp_ns, row in zip(good.stamps_ns[topic], rows, strict=True):
                writer.add_message(channel, stamp_ns, row)
        writer.finish()
        _read_whole(path)

    edits = st.lists(st.tuples(st.integers(0, 99), st.integers(0, 10**6), st.binary(max_size=24)), max_size=3)
    return st.tuples(trees(fields), edits), read


def _rig(work: Path) -> Target:
    seed = yaml.safe_load((ROOT / "examples/02_custom_rig.yaml").read_text())
    path = work / "rig.yaml"

    def read(drawn: Any) -> None:
        path.write_text(yaml.safe_dump(drawn, allow_unicode=True), encoding="utf-8")
        rig_by_name(path)

    return trees(seed), read


def _schedule(work: Path) -> Target:
    seed = [{"at_s": 0, "weather": "ClearNoon"}, {"at_s": 20.0, "weather": {"fog_density": 80.0}}]
    path = work / "schedule.yaml"

    def read(drawn: Any) -> None:
        path.write_text(yaml.safe_dump(drawn, allow_unicode=True), encoding="utf-8")
        weather_of(path).at(10**10)

    return trees(seed), read


def _town_toml() -> Target:
    seed = tomllib.loads((ROOT / "maps/Town03/town.toml").read_text())
    return trees(seed), lambda drawn: TownConfig.from_mapping(drawn) and None


def _map() -> Target:
    seed = (ROOT / "tests/data/crossing.xodr").read_bytes()

    def read(splices: Splices) -> None:
        xodr = read_opendrive(spliced(seed, splices))
        report(xodr, build_network(xodr))

    return st.one_of(attributes(seed), elements(seed), damages(seed)), read


def _tum(seeds: Seeds, work: Path) -> Target:
    truth = read_tum(seeds.tum)
    path = work / "estimate.tum"

    def read(text: str) -> None:
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        evaluate(truth, read_tum(path))

    return lines(seeds.tum.read_text()), read


def _poses(work: Path, *dressings: str) -> Target:
    (work / "times.txt").write_text("\n".join(S))
    path, truth = work / "poses.csv", drive()

    def read(text: str) -> None:
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        evaluate(truth, read_trajectory(path))

    heads = ["\n".join(DRESSINGS[name][1].splitlines()[:40]) for name in dressings]
    by = {text: "," if "," in text else " " for text in heads}
    return st.one_of(*(lines(text, by=by[text]) for text in heads)), read


def _pose_bag(seeds: Seeds, work: Path) -> Target:
    """A path that grows, and a tree of frames, from which one is chosen by the topic."""
    make, path, truth = Messages(ros2=False), work / "poses.bag", read_tum(seeds.tum)
    poses = make.poses(POSES[1], truth)
    few = [("/path", PATH, at, make.path(at, poses[:at])) for at in (3, 30, 41)]
    links = [("/tf", TF, *link) for link in make.links(truth, "map", "base_link")]
    path.unlink(missing_ok=True)
    seed = make.write(path, [*few, *links]).read_bytes()

    def read(drawn: tuple[Splices, str]) -> None:
        path.write_bytes(spliced(seed, drawn[0]))
        evaluate(truth, read_trajectory(path, topic=drawn[1]))

    return st.tuples(
        damages(seed), st.sampled_from([None, "/path", "/tf", "/tf:map.base_link", "/tf:a.b", ":"])
    ), read


def _bag(seeds: Seeds, work: Path) -> Target:
    path, seed = work / "scans.bag", seeds.bag.read_bytes()

    def read(splices: Splices) -> None:
        path.write_bytes(spliced(seed, splices))
        for _ in read_scans(path, "/lidar/points"):
            pass

    return damages(seed), read


def _point_cloud() -> Target:
    """Clouds whose fields, sizes and byte order contradict each other and their bytes."""
    small = st.integers(0, 12)
    whole = st.one_of(small, small, small, st.sampled_from([40, 2**16, 2**31, 2**32 - 1]))
    names = st.sampled_from(["x", "y", "z", "time", "t", "ring", "intensity", "label", "", "é"])
    field = st.builds(SimpleNamespace, name=names, offset=whole, datatype=st.integers(0, 9), count=whole)
    good = [
        SimpleNamespace(name=n, offset=4 * k, datatype=7, count=1) for k, n in enumerate(("x", "y", "z", "t"))
    ]
    cloud = st.builds(
        SimpleNamespace,
        header=st.builds(
            SimpleNamespace,
            stamp=st.builds(SimpleNamespace, sec=whole, nanosec=whole),
            frame_id=st.text(max_size=8),
        ),
        fields=st.lists(field, max_size=3).flatmap(lambda drawn: st.permutations([*drawn, *good])),
        is_bigendian=st.booleans(),
        height=st.one_of(st.just(1), whole),
        width=whole,
        point_step=st.one_of(st.just(16), st.just(20), whole),
        row_step=whole,
        data=st.binary(min_size=8, max_size=64).map(lambda part: np.frombuffer(part * 40, np.uint8)),
    )

    def read(messages: list[Any]) -> None:
        clouds = ((k, cloud_of_fields(message)) for k, message in enumerate(messages))
        for scan in scans_of(clouds, "drawn"):
            assert np.isfinite(scan.points_xyz_m).all()
            assert len(scan.time_s) == len(scan.points_xyz_m)
            assert np.isfinite(scan.time_s).all()

    return st.lists(cloud, min_size=1, max_size=3), read


def _command_line(seeds: Seeds, work: Path) -> Target:
    def read(argv: list[str]) -> None:
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            code = main(argv)
        assert code in (0, 1, 2), code
        assert "Traceback" not in err.getvalue()
        if "--json" in argv and code != 2 and "--help" not in argv and "-h" not in argv:
            json.loads(out.getvalue())
        if code:
            raise Refused(f"exit code {code}")

    return command_lines(seeds.episode, seeds.tum, work), read
