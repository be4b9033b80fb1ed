"""A C3D file as a DEC machine wrote it: every float with its halves exchanged and an exponent that is two higher."""

import struct

import numpy as np

BLOCK = 512


def as_dec(content: bytes) -> bytes:
    """The same file, from one of Intel's with floats for its frames."""
    made = bytearray(content)
    made[515] = 85
    _exchange(made, 12, 1)
    _exchange(made, 20, 1)
    for at, count in _floats(content):
        _exchange(made, at, count)
    (first,) = struct.unpack_from("<H", content, 16)
    start = (first - 1) * BLOCK
    _exchange(made, start, (len(content) - start) // 4)
    return bytes(made)


def _exchange(made: bytearray, at: int, count: int) -> None:
    values = np.frombuffer(bytes(made[at : at + 4 * count]), "<f4") * np.float32(4.0)
    halves = values.astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1]
    made[at : at + 4 * count] = np.ascontiguousarray(halves).tobytes()


def _floats(content: bytes) -> list[tuple[int, int]]:
    """Where in the parameters floats begin, and how many they are."""
    at, found = BLOCK + 4, []
    while length := abs(struct.unpack_from("b", content, at)[0]):
        (group,) = struct.unpack_from("b", content, at + 1)
        link = at + 2 + length
        (step,) = struct.unpack_from("<H", content, link)
        if group > 0 and content[link + 2] == 4:
            n = content[link + 3]
            found.append((link + 4 + n, int(np.prod(list(content[link + 4 : link + 4 + n]), dtype=int))))
        if step == 0:
            break
        at = link + step
    return found
