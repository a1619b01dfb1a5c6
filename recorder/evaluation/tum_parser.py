"""Machine code that reads regular TUM files: an hour of 200 Hz poses in a fraction of a second.

A number's digits make an integer m; its value is m · 10^e. Both m (as a sum of two doubles) and the power of
ten (up to 10^22) are exact, so that the quotient, taken with a remainder, is rounded but once (T. J. Dekker,
"A floating-point technique for extending the available precision", Numer. Math. 18, 1971). What is written
in another way than a regular file's is left to the slower reader.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined

_POWERS: Array = np.array([float(10**k) for k in range(23)])
_DIGITS_MAX = 9 * 10**17
"""Largest integer that may take another digit within 64 bits."""
_SPLITTER = 134217729.0
"""2^27 + 1: halves a double's digits."""
_SECONDS_MAX = 9 * 10**9
"""Stamps beyond are no seconds of this age."""
_TINY_MAX = 100_000
"""Most numbers of more than 22 decimals, which Python reads one by one."""
_SPACE, _TAB, _RETURN, _LINE, _COMMENT = 32, 9, 13, 10, 35
_ZERO, _NINE, _MINUS, _PLUS, _POINT = 48, 57, 45, 43, 46


def parse_tum(text: bytes) -> tuple[NDArray[np.int64], Array] | None:
    """Stamps [ns] (N,) and the seven other columns (N, 7) of a TUM file whose stamps are seconds.

    Args:
        text: All bytes of the file.

    Returns:
        None: a line is not eight numbers between blanks, or a stamp has digits below a nanosecond; read
        it in another way.
    """
    data = np.frombuffer(text, dtype=np.uint8)
    lines = int(np.count_nonzero(data == _LINE)) + 1
    stamps, values = np.empty(lines, dtype=np.int64), np.empty((lines, 7))
    tiny = np.empty((_TINY_MAX, 4), dtype=np.int64)
    count, left = _parse(data, stamps, values, tiny, _POWERS)
    for row, column, begin, end in tiny[:left].tolist():
        values[row, column] = float(text[begin:end])
    return (stamps[:count], values[:count]) if count > 0 else None


@compiled
def _parse(
    data: NDArray[np.uint8],
    stamps: NDArray[np.int64],
    values: Array,
    tiny: NDArray[np.int64],
    powers: Array,
) -> tuple[int, int]:
    """Number of rows (−1: no regular file), and of entries (row, column, begin, end) in `tiny`."""
    at, row, end, left = 0, 0, len(data), 0
    while at < end:
        at = _blanks(data, at)
        if at == end:
            break
        if data[at] == _LINE:
            at += 1
            continue
        if data[at] == _COMMENT:
            while at < end and data[at] != _LINE:
                at += 1
            continue
        for column in range(8):
            begin = at
            digits, decimals, exponent, negative, at = _number(data, at)
            if at < 0 or (at < end and data[at] > _SPACE):
                return -1, 0
            power = exponent - decimals
            if column == 0:
                # Seconds with at most nine decimals, of a time within some centuries, are exact.
                if negative or power < -9 or power > 0 or digits // 10**-power >= _SECONDS_MAX:
                    return -1, 0
                stamps[row] = digits * 10 ** (9 + power)
            elif -23 < power < 23:
                value = _scaled(digits, power, powers)
                values[row, column - 1] = -value if negative else value
            else:
                if left == len(tiny):
                    return -1, 0
                tiny[left] = (row, column - 1, begin, at)
                left += 1
            at = _blanks(data, at)
        if at < end and data[at] != _LINE:
            return -1, 0
        row += 1
    return row, left


@inlined
def _blanks(data: NDArray[np.uint8], at: int) -> int:
    while at < len(data) and (data[at] == _SPACE or data[at] == _TAB or data[at] == _RETURN):
        at += 1
    return at


@inlined
def _number(data: NDArray[np.uint8], at: int) -> tuple[Any, int, Any, Any, int]:
    """Digits as an integer, how many of them are decimals, exponent, sign, and where the number ends."""
    end = len(data)
    negative = at < end and data[at] == _MINUS
    if at < end and (data[at] == _MINUS or data[at] == _PLUS):
        at += 1
    value, decimals, seen, behind = np.int64(0), 0, False, False
    while at < end:
        byte = np.int64(data[at])
        if _ZERO <= byte <= _NINE:
            if value >= _DIGITS_MAX:
                return 0, 0, 0, False, -1
            value = value * 10 + (byte - _ZERO)
            decimals += behind
            seen = True
        elif byte == _POINT and not behind:
            behind = True
        else:
            break
        at += 1
    if not seen:
        return 0, 0, 0, False, -1
    exponent = np.int64(0)
    if at < end and (data[at] == 101 or data[at] == 69):  # e, E
        at += 1
        down = at < end and data[at] == _MINUS
        if at < end and (data[at] == _MINUS or data[at] == _PLUS):
            at += 1
        if at >= end or not _ZERO <= data[at] <= _NINE:
            return 0, 0, 0, False, -1
        while at < end and _ZERO <= data[at] <= _NINE and exponent < 1000:
            exponent = exponent * 10 + (np.int64(data[at]) - _ZERO)
            at += 1
        exponent = -exponent if down else exponent
    return value, decimals, exponent, negative, at


@inlined
def _scaled(digits: Any, power: Any, powers: Any) -> Any:
    """The double nearest to digits · 10^power, −22 ≤ power ≤ 22."""
    high = float(digits)
    low = float(digits - np.int64(high))
    if power == 0 or digits == 0:
        return high + low
    ten = powers[abs(power)]
    if power > 0:
        product, rest = _two_product(high, ten)
        return product + (rest + low * ten)
    quotient = high / ten
    product, rest = _two_product(quotient, ten)
    return quotient + (((high - product) - rest) + low) / ten


@inlined
def _two_product(a: Any, b: Any) -> Any:
    """Product and its rounding error (Dekker 1971)."""
    product = a * b
    t = _SPLITTER * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = _SPLITTER * b
    b_high = t - (t - b)
    b_low = b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
