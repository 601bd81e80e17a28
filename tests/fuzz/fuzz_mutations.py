"""Mutations of files: each is what happens to real ones, or what a header could claim."""

import random
from collections.abc import Callable

import numpy as np

Mutation = Callable[[bytearray, random.Random], None]

EXTREMES = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63 - 1, 2**63)
FLOATS = (0.0, -0.0, 1e-308, 1e38, 1e308, -1e308, float("nan"), float("inf"), float("-inf"), 2.0**53 + 1)
WORDS = (
    "0", "-1", "1e308", "-1e308", "nan", "inf", "1e-320", "9" * 40, str(2**31), str(2**63), str(2**64), "", " ", "\n",
    "null", "[]", "{}", "true", '""', "[[[[", "a.a.a", "\x00", "é", "\ufeff", "../..", "/dev/zero", "1,5", "0x10",
)  # fmt: skip
LARGEST = 4 * 2**20


def mutated(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """Return `data` after one to six mutations; `others` are files of the same kind, to be spliced in."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        if rng.random() < 0.1 and others:
            other = rng.choice(others)
            begin = rng.randrange(len(other) + 1)
            part = other[begin : begin + rng.choice((8, 64, 512, 10**6))]
            at = _place(changed, rng)
            changed[at : at + rng.choice((0, len(part)))] = part
        else:
            rng.choice(MUTATIONS)(changed, rng)
    return bytes(changed[:LARGEST])


def _place(data: bytearray, rng: random.Random) -> int:
    """A place in the data, half of the time in its first 512 bytes: headers matter most. Some have it at the end."""
    if rng.random() < 0.5:
        return rng.randrange(min(len(data), 512) + 1)
    if rng.random() < 0.3:
        return max(0, len(data) - rng.randrange(513))
    return rng.randrange(len(data) + 1)


def _flip_bits(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 2, 8)) if data else 0):
        data[min(_place(data, rng), len(data) - 1)] ^= 1 << rng.randrange(8)


def _other_bytes(data: bytearray, rng: random.Random) -> None:
    """Overwrite with random bytes, zeros, or an extreme number of any kind."""
    n, size = rng.choice((1, 2, 4, 16, 200)), rng.choice((1, 2, 4, 4, 8))
    whole = (rng.choice(EXTREMES) + rng.choice((0, 0, 1, -1))) % 2 ** (8 * size)
    with np.errstate(over="ignore"):
        real = np.array([rng.choice(FLOATS)]).astype(rng.choice(("<d", "<f4"))).tobytes()
    integer = whole.to_bytes(size, rng.choice(("little", "little", "big")))
    part = rng.choice((rng.randbytes(n), bytes(n), bytes(20 * n), integer, integer, real))
    at = _place(data, rng)
    data[at : at + len(part)] = part


def _truncate(data: bytearray, rng: random.Random) -> None:
    del data[_place(data, rng) :]


def _remove(data: bytearray, rng: random.Random) -> None:
    at = _place(data, rng)
    del data[at : at + rng.choice((1, 2, 4, 8, 100, 1000))]


def _repeat(data: bytearray, rng: random.Random) -> None:
    at = _place(data, rng)
    data[at:at] = data[at : at + rng.choice((1, 4, 40, 400))] * rng.choice((1, 2, 10, 300))


def _word(data: bytearray, rng: random.Random) -> None:
    """Put a word where a number of a text begins, or anywhere."""
    at = _place(data, rng)
    while at < len(data) and rng.random() < 0.95 and not chr(data[at]).isdigit():
        at += 1
    end = at
    while end < len(data) and chr(data[end]) in "0123456789.eE-+":
        end += 1
    data[at:end] = rng.choice(WORDS).encode()


def _swap_lines(data: bytearray, rng: random.Random) -> None:
    lines = data.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]
    data[:] = b"\n".join(lines)


MUTATIONS: tuple[Mutation, ...] = (
    *[_flip_bits] * 2, *[_other_bytes] * 4, _truncate, _remove, _repeat, *[_word] * 2, _swap_lines,
)  # fmt: skip
