"""Byte layout of messages, derived from their ROS 2 definitions: for numpy, for `struct`, for single values.

Messages are CDR as ROS 2 sends it (OMG DDS-XTypes, plain CDR version 1): a word that names the encoding, then
every value at a multiple of its size; sequences begin with their length, strings end with a zero byte.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

ENCAPSULATION = 0x0000_0100
"""First word of every message, as a little-endian number: CDR, little-endian."""
_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
"""`struct` codes of the primitive types; numpy has the same."""
_FIELD = re.compile(r"(?P<kind>\w+)(?P<array>\[(?P<length>\d*)\])?\s+(?P<name>[a-z]\w*)$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One line of a message definition."""

    name: str
    """Name of the value."""
    kind: str
    """Primitive type, or ``string``."""
    length: int | None
    """Length of a fixed array, None of a single value or a sequence."""
    is_sequence: bool
    """Whether the number of values differs from message to message."""

    @property
    def size(self) -> int:
        """Size of one value, and what its position is a multiple of [byte]; 1 of a string's characters."""
        return 1 if self.kind == "string" else struct.calcsize("<" + _CODES[self.kind])


@dataclass(frozen=True, kw_only=True)
class RecordType:
    """A kind of messages of an episode.

    Raises:
        ValueError: the definition holds something else than primitive types, their arrays, and strings.
    """

    topic: str
    """Where such messages stand."""
    name: str
    """Name of the type, e.g. ``carlaloc_msgs/msg/Event``."""
    definition: str
    """Text of its ``.msg`` file."""

    def __post_init__(self) -> None:
        self.fields  # noqa: B018  a bad definition fails where it is written

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """Values of a message, in order."""
        lines = (line.partition("#")[0].strip() for line in self.definition.splitlines())
        return tuple(_field(line) for line in lines if line)

    def dtype(self, lengths: Mapping[str, int] | None = None) -> np.dtype[np.void]:
        """Layout for numpy, with the fields' names.

        Beside them stand ``encapsulation``, ``<name>_count`` before each sequence, and padding.

        Args:
            lengths: Length of each sequence by its name.
        """
        return _dtype(self, tuple(sorted((lengths or {}).items())))

    def row(self, lengths: Mapping[str, int] | None = None) -> NDArray[np.void]:
        """A message to be filled in, shape (): all zeros but the encapsulation and the sequences' lengths."""
        row = np.zeros((), dtype=self.dtype(lengths))
        row["encapsulation"] = ENCAPSULATION
        for name, length in (lengths or {}).items():
            row[f"{name}_count"] = length
        return row

    def rows(self, payloads: Sequence[bytes], lengths: Mapping[str, int] | None = None) -> NDArray[np.void]:
        """Messages as rows of one array.

        Raises:
            ValueError: a message has another size.
        """
        dtype = self.dtype(lengths)
        if any(len(payload) != dtype.itemsize for payload in payloads):
            raise ValueError(f"{self.name} not of {dtype.itemsize} bytes")
        return np.frombuffer(b"".join(payloads), dtype=dtype)

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Bytes of a message of single values and strings."""
        out = bytearray(struct.pack("<I", ENCAPSULATION))
        for field in self.fields:
            out += bytes(-(len(out) - 4) % (4 if field.kind == "string" else field.size))
            if field.kind == "string":
                text = values[field.name].encode() + b"\0"
                out += struct.pack("<I", len(text)) + text
            else:
                out += struct.pack("<" + _CODES[field.kind], values[field.name])
        return bytes(out)

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Values of a message of single values and strings, by name.

        Raises:
            ValueError: a text is not UTF-8.
            struct.error: the message is too short.
        """
        at, values = 4, dict[str, Any]()
        for field in self.fields:
            size = 4 if field.kind == "string" else field.size
            at += -(at - 4) % size
            code = "I" if field.kind == "string" else _CODES[field.kind]
            (value,) = struct.unpack_from(f"<{code}", payload, at)
            at += size
            if field.kind == "string":
                values[field.name] = payload[at : at + value - 1].decode()
                at += value
            else:
                values[field.name] = value
        return values


def payloads_of(rows: NDArray[np.void]) -> list[bytes]:
    """Bytes of each row of a `RecordType`'s layout."""
    whole, size = rows.tobytes(), rows.dtype.itemsize
    return [whole[begin : begin + size] for begin in range(0, len(whole), size)]


def _field(line: str) -> Field:
    match = _FIELD.fullmatch(line)
    if match is None or (match["kind"] not in _CODES and (match["kind"] != "string" or match["array"])):
        raise ValueError(f"'{line}' is no field of a primitive type")
    length = int(match["length"]) if match["length"] else None
    is_sequence = match["array"] is not None and length is None
    return Field(name=match["name"], kind=match["kind"], length=length, is_sequence=is_sequence)


@lru_cache(maxsize=64)
def _dtype(record: RecordType, lengths: tuple[tuple[str, int], ...]) -> np.dtype[np.void]:
    count_of = dict(lengths)
    parts: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = [("encapsulation", "<u4")]
    end = 0

    def align(size: int, name: str) -> None:
        nonlocal end
        if gap := -end % size:
            parts.append((f"padding_before_{name}", "u1", (gap,)))
            end += gap

    for field in record.fields:
        if field.kind == "string":
            raise ValueError(f"{record.name} holds a text, {field.name}: numpy has no layout for it")
        count = count_of[field.name] if field.is_sequence else field.length
        if field.is_sequence:
            align(4, f"{field.name}_count")
            parts.append((f"{field.name}_count", "<u4"))
            end += 4
        if count != 0:
            align(field.size, field.name)
        code = np.dtype("<" + _CODES[field.kind]).str
        parts.append((field.name, code) if count is None else (field.name, code, (count,)))
        end += field.size * (1 if count is None else count)
    return np.dtype(parts)
