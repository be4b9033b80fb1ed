"""The MATLAB of the examples, as far as they use it: read a script, and carry its HTTP calls out.

No MATLAB and no Octave runs here, so this cannot say that the script runs there. It says that whatever the script sends
is taken by a service: values are those of the script, and messages are put together as MathWorks' documentation of
``webread``, ``webwrite``, ``websave`` and ``matlab.net.http`` says. What is not known is an error, never passed over.
"""

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import httpx

TOKEN: Final = re.compile(r"\s*('(?:[^']|'')*'|\d+(?:\.\d+)?|[A-Za-z_][\w.]*|~=|==|[\[\](){},~])")
ENUMERATION: Final = {"matlab.net.http.StatusCode.Created": 201}
BOUNDARY: Final = "one-boundary-of-a-form"


@dataclass
class Reader:
    """Evaluates one expression after another; ``names`` are the variables, ``functions`` what may be called."""

    names: dict[str, Any]
    functions: Mapping[str, Callable[..., Any]]
    tokens: list[str] = field(default_factory=list)

    def value(self, text: str) -> Any:
        self.tokens, at = [], 0
        while text[at:].strip():
            token = TOKEN.match(text, at)
            assert token, f"not read: {text[at:]}"
            self.tokens.append(token.group(1))
            at = token.end()
        answer = self._compared()
        assert not self.tokens, f"not read: {self.tokens} of {text}"
        return answer

    def _compared(self) -> Any:
        first_value = self._single()
        if self.tokens and self.tokens[0] in ("~=", "=="):
            same, right = self.tokens.pop(0) == "==", self._single()
            return (first_value == right) is same
        return first_value

    def _single(self) -> Any:
        token = self.tokens.pop(0)
        if token == "~":
            return not self._single()
        if token == "[":
            return "".join(self._until("]")) if self.tokens[0] != "]" else (self._until("]") or None)
        if token == "{":
            return self._until("}")
        if token.startswith("'"):
            return token[1:-1].replace("''", "'")
        if token[0].isdigit():
            return float(token) if "." in token else int(token)
        return self._named(token)

    def _until(self, close: str) -> list[Any]:
        values = []
        while self.tokens[0] != close:
            values.append(self._compared())
            if self.tokens[0] == ",":
                self.tokens.pop(0)
        self.tokens.pop(0)
        return values

    def _named(self, token: str) -> Any:
        if token in ENUMERATION:
            return ENUMERATION[token]
        if self.tokens and self.tokens[0] == "(" and token in self.functions:
            self.tokens.pop(0)
            return self.functions[token](*self._until(")"))
        first, *rest = token.split(".")
        value = self.names[first]
        for part in rest:
            value = value[part]
        return value


def run(script: str, functions: Mapping[str, Callable[..., Any]], given: Mapping[str, Any]) -> dict[str, Any]:
    """Carry out a script, with ``given`` in the place of its own values of these names; returns the variables."""
    lines = [line.split("%", 1)[0].rstrip() if "'" not in line else line.rstrip() for line in script.splitlines()]
    reader = Reader({}, functions)
    _block(iter([line for line in lines if line and not line.startswith("%")]), reader, given, active=True)
    return reader.names


def _block(lines: Iterator[str], reader: Reader, given: Mapping[str, Any], *, active: bool) -> None:
    for line in lines:
        word, _, rest = line.strip().partition(" ")
        if word == "end":
            return
        if word in ("while", "if"):
            body = _body(lines)
            while active and reader.value(rest):
                _block(iter(body), reader, given, active=active)
                if word == "if":
                    break
            continue
        assert line.endswith(";"), f"an expression without semicolon: {line}"
        assigned = re.match(r"\s*(\w+) = (.*);$", line)
        if assigned is None:
            reader.value(line.strip()[:-1])
            continue
        name, text = assigned.groups()
        reader.names[name] = given[name] if name in given else reader.value(text)


def _body(lines: Iterator[str]) -> list[str]:
    """Lines up to the ``end`` of a loop or a condition."""
    body: list[str] = []
    depth = 1
    for line in lines:
        word = line.split()[0]
        depth += (word in ("while", "if")) - (word == "end")
        if depth == 0:
            return body
        body.append(line)
    raise AssertionError("an end is missing")


@dataclass(frozen=True)
class Form:
    """A multipart form as ``MultipartFormProvider`` sends it: names with texts or files, chunked."""

    parts: tuple[tuple[str, str | Path], ...]

    def pieces(self) -> Iterator[bytes]:
        for name, part in self.parts:
            head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"'
            if isinstance(part, Path):
                head += f'; filename="{part.name}"\r\nContent-Type: application/octet-stream'
            else:
                head += "\r\nContent-Type: text/plain; charset=utf-8"
            content = part.read_bytes() if isinstance(part, Path) else part.encode()
            yield f"{head}\r\n\r\n".encode() + content + b"\r\n"
        yield f"--{BOUNDARY}--\r\n".encode()


@dataclass
class Web:
    """MATLAB's functions on one service; ``calls`` keeps what was sent: method, address, query, names in the body."""

    http: httpx.Client
    folder: Path
    calls: list[tuple[str, str, set[str], set[str]]] = field(default_factory=list)

    def functions(self) -> dict[str, Callable[..., Any]]:
        silent = dict.fromkeys(("fprintf", "errorbar"), lambda *_: None)
        return silent | {
            "weboptions": lambda *pairs: {"options": _struct(*pairs)},
            "struct": _struct,
            "webread": self.webread,
            "webwrite": self.webwrite,
            "websave": self.websave,
            "readtable": self.readtable,
            "ismember": lambda text, cell: text in cell,
            "strcmp": lambda one, other: one == other,
            "string": str,
            "error": self.error,
            "matlab.net.http.io.FileProvider": lambda name: self.folder / name,
            "matlab.net.http.io.MultipartFormProvider": lambda *pairs: Form(tuple(_struct(*pairs).items())),
            "matlab.net.http.RequestMessage": lambda method, header, form: (method, header, form),
            "send": self.send,
        }

    def webread(self, url: str, *more: Any) -> Any:
        query = _struct(*more[:-1])
        return self._sent("GET", url, query, timeout=more[-1]["options"]["Timeout"]).json()

    def webwrite(self, url: str, data: dict[str, Any], options: Any) -> Any:
        assert options["options"]["MediaType"] == "application/json", "a struct is sent as a form without this"
        headers = {"Content-Type": "application/json"}
        return self._sent("POST", url, {}, data, content=json.dumps(data), headers=headers).json()

    def websave(self, name: str, url: str, _options: Any) -> None:
        (self.folder / name).write_bytes(self._sent("GET", url, {}).content)

    def readtable(self, name: str) -> dict[str, list[str]]:
        with (self.folder / name).open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        return {column: [row[i] for row in rows] for i, column in enumerate(head)}

    def send(self, message: tuple[str, None, Form], url: str) -> Any:
        method, _, form = message
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
        answer = self._sent(method, url, {}, dict(form.parts), content=form.pieces(), headers=headers)
        return {"StatusCode": answer.status_code, "Body": {"Data": answer.json()}}

    def error(self, _code: str, pattern: str, *values: Any) -> None:
        raise AssertionError(pattern % values)

    def _sent(self, method: str, url: str, query: dict[str, Any], body: Any = (), **more: Any) -> httpx.Response:
        self.calls.append((method, url, set(query), set(body)))
        return self.http.request(method, url, params=query, **more).raise_for_status()


def _struct(*pairs: Any) -> dict[str, Any]:
    return dict(zip(pairs[::2], pairs[1::2], strict=True))
