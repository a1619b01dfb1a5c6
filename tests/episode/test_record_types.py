"""Layouts derived from message definitions, against the serialiser of rosbags."""

import random
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from shared_fixtures.drives.episodes import SIGNALS, frame_of, row_of

from recorder.episode.actor_messages import ACTORS, actor_states, pack_actors, unpack_actors
from recorder.episode.ego_messages import EGO, EVENT, EgoRow, pack_ego
from recorder.episode.record_types import RecordType

KINDS = (
    "bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64",
)  # fmt: skip


class Rosbags:
    """What rosbags makes of the same definition."""

    def __init__(self, record: RecordType) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._store.register(get_types_from_msg(record.definition, record.name))
        self._name = record.name

    def serialised(self, values: dict[str, Any]) -> bytes:
        return bytes(self._store.serialize_cdr(self._store.types[self._name](**values), self._name))

    def read(self, payload: bytes) -> Any:
        return self._store.deserialize_cdr(payload, self._name)


def random_record(
    rng: random.Random, *, with_texts: bool
) -> tuple[RecordType, dict[str, Any], dict[str, int]]:
    """A definition of random fields, values for it, and the lengths of its sequences."""
    lines, values, lengths = [], dict[str, Any](), dict[str, int]()
    for k in range(rng.randrange(1, 12)):
        name, kind = f"field_{k}", rng.choice((*KINDS, "string") if with_texts else KINDS)
        shape = "" if with_texts else rng.choice(("", "[3]", "[]"))
        lines.append(f"{kind}{shape} {name}  # {rng.choice('abc')}")
        count = {"": 1, "[3]": 3, "[]": rng.randrange(6)}[shape]
        if kind == "string":
            values[name] = "ü" * rng.randrange(7)
            continue
        dtype = np.dtype(kind)
        numbers = np.frombuffer(rng.randbytes(8 * count), np.uint64) % 250
        array = (numbers % 2 if kind == "bool" else numbers % 100).astype(dtype)
        values[name] = array if shape else array[0].item()
        if shape == "[]":
            lengths[name] = count
    record = RecordType(topic="/x", name="test_msgs/msg/Random", definition="\n".join(lines))
    return record, values, lengths


def test_random_definitions_give_the_bytes_of_rosbags() -> None:
    """Single values and texts."""
    rng = random.Random(1)
    for _trial in range(60):
        record, values, _ = random_record(rng, with_texts=True)
        ours = record.pack(values)
        assert ours == Rosbags(record).serialised(values), record.definition
        found = record.unpack(ours)
        for name, value in values.items():
            assert np.array_equal(found[name], value), record.definition


def test_random_arrays_give_the_bytes_of_rosbags() -> None:
    """Sequences of any length between values of any size: numpy rows read and write the same bytes."""
    rng = random.Random(2)
    for _ in range(80):
        record, values, lengths = random_record(rng, with_texts=False)
        row = record.row(lengths)
        for name, value in values.items():
            row[name] = value
        theirs = Rosbags(record).serialised(values)
        assert row.tobytes() == theirs, record.definition
        (found,) = record.rows([theirs], lengths)
        for name, value in values.items():
            assert np.array_equal(found[name], value), record.definition


def test_messages_of_an_episode_are_those_of_rosbags() -> None:
    """Rules out a file that only we can read."""
    row = row_of(5)
    packed = pack_ego(5, [row]).tobytes()
    ego = Rosbags(EGO).read(packed)
    assert ego.tick == 5
    assert ego.quat_xyzw.tolist() == np.asarray(row.quat_xyzw).tolist()
    assert Rosbags(EGO).serialised(vars(ego) | {}) == packed
    for count in range(6):
        ours = pack_actors(9, [frame_of(9, count)], [np.arange(SIGNALS, dtype=np.uint8)]).tobytes()
        frame = Rosbags(ACTORS).read(ours)
        assert frame.signals.tolist() == list(range(SIGNALS))
        assert Rosbags(ACTORS).serialised(vars(frame) | {}) == ours
        states = actor_states(unpack_actors([ours, ours], count))
        assert np.array_equal(states.position_m[1], frame_of(9, count).position_m)
    for kind in ("a", "ab", "abc", "abcd"):
        values = {"tick": 3, "kind": kind, "json": '{"x": 1}'}
        assert EVENT.pack(values) == Rosbags(EVENT).serialised(values)
        assert EVENT.unpack(EVENT.pack(values)) == values


def test_what_cannot_be_laid_out_is_refused() -> None:
    for line in ("geometry_msgs/Pose pose", "string[] names", "float64", "float64[<=3] few", "int64 X=3"):
        with pytest.raises(ValueError, match="is no field"):
            RecordType(topic="/x", name="test_msgs/msg/Bad", definition=line)
    with pytest.raises(ValueError, match="numpy has no layout"):
        EVENT.dtype()
    with pytest.raises(ValueError, match="shape"):
        pack_ego(0, [EgoRow(position_m=(0.0, 0.0), quat_xyzw=(0.0, 0.0, 0.0, 1.0))])
    with pytest.raises(ValueError, match="not of 216 bytes"):
        EGO.rows([b"too short"])
