"""Checks of a C3D file's header and parameter records, before a C library gets to see them.

Layout after the C3D user manual (c3d.org): 512-byte header; parameter records, each a chain of groups and
parameters linked by 16-bit offsets; then frames of points and analog samples.
"""

import struct
from pathlib import Path

from stridelab.errors import Fault, UnreadableFile

_BLOCK = 512
_MAX_POINTS = 2000
_MAX_ANALOG_PER_FRAME = 40000
_MAX_VALUES = 200_000_000


def check_c3d(path: Path) -> None:
    """Raise ``UnreadableFile`` unless header, parameter section and data fit into the file."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_BLOCK)
        if size == 0:
            raise UnreadableFile("empty-file", "The file is empty (0 bytes).", [Fault(path.name, "0 bytes")])
        if len(head) < 2 or head[1] != 0x50:
            raise UnreadableFile("not-c3d", "This is not a C3D file.", [Fault(path.name, "no C3D key in the header")])
        if len(head) < _BLOCK or head[0] < 2 or size < head[0] * _BLOCK:
            raise _truncated(path, "the header")
        file.seek((head[0] - 1) * _BLOCK)
        parameters = file.read(4)
        processor = parameters[3] if len(parameters) == 4 else 0
        if processor not in (84, 85, 86):
            raise UnreadableFile(
                "c3d-parameters-broken",
                "The C3D file's parameter section is damaged.",
                [Fault(path.name, f"unknown processor type {processor}")],
            )
        file.seek((head[0] - 1) * _BLOCK)
        section = file.read(parameters[2] * _BLOCK)
    order = ">" if processor == 86 else "<"
    _check_chain(path, section, order)
    _check_data(path, head, order, size)


def _truncated(path: Path, what: str) -> UnreadableFile:
    return UnreadableFile(
        "truncated-file", f"The C3D file ends in the middle of {what}.", [Fault(path.name, "truncated")]
    )


def _check_chain(path: Path, section: bytes, order: str) -> None:
    """Follow the chain of parameter records: it must end inside the section and go forward only."""
    at = 4
    while True:
        if at + 2 > len(section):
            raise _truncated(path, "the parameter section")
        name_length = abs(struct.unpack_from("b", section, at)[0])
        if name_length == 0:
            return
        link = at + 2 + name_length
        if link + 2 > len(section):
            raise _truncated(path, "the parameter section")
        (step,) = struct.unpack_from(order + "H", section, link)
        if step == 0:
            return
        at = link + step


def _check_data(path: Path, head: bytes, order: str, size: int) -> None:
    """Frames times values must fit between the start of the data and the end of the file."""
    n_points, n_analog, first, last = struct.unpack_from(order + "4H", head, 2)
    (data_block,) = struct.unpack_from(order + "H", head, 16)
    raw_scale = head[12:16]
    # DEC floats keep the sign bit in the same place once their two words are swapped.
    negative = bool((raw_scale[0] if order == ">" else raw_scale[3]) & 0x80) or bool(
        raw_scale[1] & 0x80 and order == "<"
    )
    if n_points > _MAX_POINTS or n_analog > _MAX_ANALOG_PER_FRAME:
        raise UnreadableFile(
            "absurd-c3d-header",
            f"The C3D header promises {n_points} points and {n_analog} analog values per frame; that is no recording.",
            [Fault(path.name, "absurd counts")],
        )
    frames = last - first + 1
    if n_points == 0 and n_analog == 0:
        return
    if frames <= 0 and last != 65535:
        raise UnreadableFile(
            "absurd-c3d-header",
            f"The C3D header counts frames from {first} to {last}.",
            [Fault(path.name, "no frames")],
        )
    values = frames * (4 * n_points + n_analog)
    if values > _MAX_VALUES:
        raise UnreadableFile("absurd-c3d-header", "The C3D header promises more data than any recording has.", [])
    start = (data_block - 1) * _BLOCK if data_block else 0
    if start <= 0 or start + values * (4 if negative else 2) > size:
        raise _truncated(path, "its frames")
