"""Mutations of files: random damage, careless programs and malice."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable, Sequence

# Largest size of a mutated file, bytes, so that slowness comes from the reader and not from the size.
LONGEST = 60_000

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
NUMBERS = (
    *(b"nan", b"-nan", b"inf", b"-Infinity", b"NaN", b"Infinity", b"0", b"-0", b"-1", b"1", b"0.0", b"5e-324"),
    *(b"1e-310", b"1e308", b"1e309", b"-1e999", b"1e-999999999", b"1e999999999", b"1e99999999999999999999"),
    *(b"9223372036854775807", b"9223372036854775808", b"-9223372036854775808", b"-9223372036854775809"),
    *(b"18446744073709551616", b"340282366920938463463374607431768211456", b"1" + b"0" * 400, b"9" * 5000),
    *(b"0x10", b"1_000", b"1,5", b"+", b"-", b".", b"1.", b".5", b"1.2.3", b"1e", b"\xd9\xa3", b"\xef\xbc\x91"),
    *(b'""', b"''", b"null", b"true", b"[]", b"{}", b"[[]]", b"()", b"''''", b"2024-01-01", b"12:30:45", b"!!float x"),
)
WORDS = (
    *(b"\0", b"\r", b"\r\n", b"\n", b"\n\n\n", b"\t", b" ", b"  ", b";", b",", b",,,,", b":", b"#", b"%", b'"', b"'"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\xff", b"\xc3", b"\xe2\x80\xa8", b"\xc2\x85", b"\x0b", b"\x0c"),
    *(b"\x1c", b"\x1a", b"\xed\xa0\x80", b"\xf0\x9f\x98\x80", b"[", b"]", b"{", b"}", b"{}", b"[]", b"&a", b"*a"),
    *(b"<<: *a", b"!!python/object/apply:os.system [id]", b"!!binary", b"\\u0000", b"\\ud800", b"=", b"'''", b'"""'),
)
INTEGERS = (0, 1, 2, 3, 7, 8, 16, 32, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**63)

Mutation = Callable[[bytearray, random.Random, Sequence[bytes]], bytes]


def mutated(seed: bytes, rng: random.Random, others: Sequence[bytes], *, text: bool) -> bytes:
    """Return `seed` after one to five mutations; `others` are files to take pieces from."""
    data = seed
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5))):
        kinds = (*ANYWHERE, *(IN_TEXT if text else IN_BINARY))
        data = rng.choice(kinds)(bytearray(data), rng, others)[:LONGEST]
    return data


def _place(data: bytearray, rng: random.Random) -> int:
    # The start of a file contains its structure, so most of the damage is done there.
    return rng.randrange(min(len(data), rng.choice((64, 512, LONGEST))) or 1)


def _flip(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if data:
            data[_place(data, rng)] ^= 1 << rng.randrange(8)
    return bytes(data)


def _truncate(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    return bytes(data[: rng.randrange(len(data) + 1)])


def _cut(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    start = _place(data, rng)
    del data[start : start + rng.choice((1, 2, 4, 16, 100, 1000))]
    return bytes(data)


def _repeat(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    start = _place(data, rng)
    piece = data[start : start + rng.choice((1, 2, 8, 32, 256))]
    data[start:start] = piece * rng.choice((1, 2, 5, 50, 1000))
    return bytes(data)


def _splice(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    other = rng.choice(others)
    start, end = sorted((rng.randrange(len(other) + 1), rng.randrange(len(other) + 1)))
    place = _place(data, rng)
    data[place : place + rng.choice((0, end - start))] = other[start:end]
    return bytes(data)


def _word(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    place = _place(data, rng)
    data[place : place + rng.choice((0, 1))] = rng.choice(WORDS) * rng.choice((1, 1, 1, 3, 2000))
    return bytes(data)


def _number(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    numbers = list(NUMBER.finditer(data))
    if not numbers:
        return _word(data, rng, others)
    for match in sorted(rng.sample(numbers, min(len(numbers), rng.choice((1, 1, 2, 10)))), key=lambda m: -m.start()):
        data[match.start() : match.end()] = rng.choice(NUMBERS)
    return bytes(data)


def _swap_numbers(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    numbers = list(NUMBER.finditer(data))
    if len(numbers) < 2:
        return _flip(data, rng, others)
    first, second = sorted(rng.sample(numbers, 2), key=lambda m: m.start())
    return bytes(
        data[: first.start()] + second[0] + data[first.end() : second.start()] + first[0] + data[second.end() :]
    )


def _lines(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    lines = bytes(data).split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            lines[i:i] = [lines[i]] * rng.choice((1, 2, 100))
        case 1:
            del lines[i : i + rng.choice((1, 3))]
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i] = lines[j][: rng.randrange(len(lines[j]) + 1)]
        case _:
            lines.insert(i, rng.choice((b"", b"#", b"# a comment", b"a,b,c,d", b"1 2 3", b"nan " * 4, b"1" * 3000)))
    return b"\n".join(lines)


def _columns(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    lines = bytes(data).split(b"\n")
    mark = rng.choice((b",", b" ", b";", b"\t"))
    column = rng.randrange(8)
    for i, line in enumerate(lines):
        cells = line.split(mark)
        if column < len(cells):
            del cells[column]
            lines[i] = mark.join(cells)
    return b"\n".join(lines)


def _nest(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    depth = rng.choice((3, 100, 900, 5000, 50_000))
    opening, closing = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a: ", b"}"), (b"- ", b""), (b"(", b")")))
    piece = opening * depth + b"1" + closing * depth * rng.randrange(2)
    numbers = list(NUMBER.finditer(data))
    if numbers and rng.random() < 0.7:
        match = rng.choice(numbers)
        data[match.start() : match.end()] = piece
    else:
        place = _place(data, rng)
        data[place:place] = piece
    return bytes(data)


def _integer(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    size = rng.choice((1, 2, 4, 8))
    if len(data) >= size:
        value = rng.choice(INTEGERS) & (2 ** (8 * size) - 1)
        if rng.random() < 0.3:
            value = 2 ** (8 * size) - 1 - value
        place = rng.randrange(min(len(data) - size + 1, rng.choice((128, 1024, LONGEST))))
        data[place : place + size] = value.to_bytes(size, rng.choice(("little", "big")))
    return bytes(data)


def _float(data: bytearray, rng: random.Random, others: Sequence[bytes]) -> bytes:
    kind = rng.choice(["<f", "<d", ">f", ">d"])
    value = rng.choice((float("nan"), float("inf"), -float("inf"), 1e-310 if kind[1] == "d" else 1e-40, 3e38, -0.0))
    place = _place(data, rng)
    packed = struct.pack(kind, value)
    data[place : place + len(packed)] = packed
    return bytes(data)


ANYWHERE: tuple[Mutation, ...] = (_flip, _truncate, _cut, _repeat, _splice)
IN_TEXT: tuple[Mutation, ...] = (*3 * (_number,), _word, _word, _swap_numbers, _lines, _lines, _columns, _nest)
IN_BINARY: tuple[Mutation, ...] = (_integer, _integer, _integer, _flip, _float)
