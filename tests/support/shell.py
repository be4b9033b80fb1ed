"""Shell lines of the book taken apart into simple commands; nothing is run."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass

ASSIGNMENT = re.compile(r"([A-Za-z_]\w*)=(.*)", re.DOTALL)
SEPARATORS = {"|", "||", "&&", ";", "&"}
GRAMMAR = {"if", "then", "else", "fi", "while", "until", "do", "done", "!"}
"""Words of the shell itself, before a command."""


@dataclass(frozen=True)
class Command:
    """``program`` with its arguments, what is assigned before it, and the command whose output it reads.

    What ``$(...)`` stands for reads ``$VALUE``.
    """

    program: str
    arguments: tuple[str, ...]
    assigned: dict[str, str]
    fed_by: "Command | None" = None


def commands(text: str) -> list[Command]:
    """All simple commands of a script, those inside of ``$(...)`` first; open quotes are a ``ValueError``."""
    joined = re.sub(r"\\\n\s*", " ", text)
    joined = re.sub(r"(\||&&)[ \t]*(?:#[^\n]*)?\n\s*", r"\1 ", joined)
    return [command for line in joined.splitlines() for command in _of_line(line)]


def _of_line(line: str) -> Iterator[Command]:
    outer, inner = _substituted(line)
    for part in inner:
        yield from _of_line(part)
    reader = shlex.shlex(outer, posix=True, punctuation_chars="|&;<>")
    reader.whitespace_split = True
    words: list[str] = []
    before: Command | None = None
    for word in [*reader, ";"]:
        if word in SEPARATORS:
            if words:
                before = _command(words, before)
                yield before
            before = before if word == "|" else None
            words = []
        elif words or word not in GRAMMAR:
            words.append(word)


def _substituted(line: str) -> tuple[str, list[str]]:
    """The line with ``$VALUE`` for every ``$(...)``, and what stood in them."""
    inner = []
    while (start := line.find("$(")) >= 0:
        depth, end = 1, start + 2
        while depth:
            if end >= len(line):
                raise ValueError(f"$( is never closed: {line}")
            depth += {"(": 1, ")": -1}.get(line[end], 0)
            end += 1
        inner.append(line[start + 2 : end - 1])
        line = line[:start] + "$VALUE" + line[end:]
    return line, inner


def _command(words: list[str], fed_by: Command | None) -> Command:
    kept: list[str] = []
    place = iter(words)
    for word in place:
        if set(word) <= set("<>&"):
            next(place, None)  # where it is read from or written to
        else:
            kept.append(word)
    assigned = {}
    while kept and (found := ASSIGNMENT.fullmatch(kept[0])):
        assigned[found[1]] = found[2]
        kept.pop(0)
    if kept and kept[0] == "export":
        assigned |= {m[1]: m[2] for word in kept[1:] if (m := ASSIGNMENT.fullmatch(word))}
    return Command(kept[0] if kept else "", tuple(kept[1:]), assigned, fed_by)
