"""Reading of scenarios from files or by the names of bundled ones."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput, NotFound, TooLarge, UnreadableFile
from stridelab.machine.models_folder import models_dir
from stridelab.schemas.base import Contract
from stridelab.schemas.scenarios import Scenario

T = TypeVar("T", bound=Contract)

MAX_SCENARIO_BYTES: Final = 1_000_000
"""Maximum size of a scenario file, as in the service."""

MAX_QUOTED_NAME: Final = 60
"""Maximum length of names quoted in messages."""

_KIND_TAGS: Final = ("box", "rail", "level", "stairs", "ramp", "stones", "bar", "gap")


def bundled_names() -> tuple[str, ...]:
    """Names of the scenarios that come with the program."""
    return tuple(sorted(path.stem for path in (models_dir() / "scenarios").glob("*.json")))


def is_bundled(typed: str) -> bool:
    """Whether ``typed`` names a bundled scenario rather than a file."""
    return typed in bundled_names() and not Path(typed).is_file()


def read_scenario(typed: str) -> Scenario:
    """The scenario of a file, or the bundled one of that name.

    Raises ``NotFound`` (``scenario-not-found``) where there is neither, ``UnreadableFile`` (``file-not-readable``,
    ``not-json``), ``TooLarge`` (``file-too-large``), and ``InvalidInput`` (``scenario-invalid``) naming every
    invalid field.
    """
    return validate_document(Scenario, read_document(typed), typed, "scenario")


def known_scenario(typed: str, *, on_service: bool) -> Scenario | None:
    """The scenario of a file or a bundled one; None for another name, which a service may have as a scenario id.

    Raises as ``read_scenario``, with ``NotFound`` only where there is no service.
    """
    try:
        return read_scenario(typed)
    except NotFound:
        if not on_service:
            raise
        return None


def read_document(typed: str) -> Any:
    """Parsed JSON of a file or of a bundled scenario. Raises as ``read_scenario``, except for invalid fields."""
    path = models_dir() / "scenarios" / f"{typed}.json" if is_bundled(typed) else Path(typed)
    if not path.exists():
        bundled = ", ".join(bundled_names())
        raise NotFound(
            "scenario-not-found", f"There is no file {typed} and no bundled scenario {typed}; there are {bundled}."
        )
    return read_json(path, MAX_SCENARIO_BYTES)


def read_json(path: Path, max_bytes: int) -> Any:
    """Parsed content of a JSON file.

    Raises ``UnreadableFile`` (``file-not-readable``, ``not-json``), ``TooLarge`` (``file-too-large``), and
    ``InvalidInput`` (``name-twice``) where an object has two entries of the same name.
    """
    try:
        if path.stat().st_size > max_bytes:
            raise TooLarge("file-too-large", f"{path} is larger than {max_bytes} bytes, too large for a scenario.")
        return json.loads(path.read_bytes().decode("utf-8"), object_pairs_hook=_unique_entries)
    except OSError as error:
        reason = error.strerror or "it cannot be opened"
        raise UnreadableFile("file-not-readable", f"Cannot read {path}: {reason}.") from error
    except UnicodeDecodeError as error:
        raise UnreadableFile("not-json", f"{path} is not JSON: it is not UTF-8 text.") from error
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise UnreadableFile("not-json", f"{path} is not JSON: {error.msg} in {where}.") from error
    except (RecursionError, ValueError) as error:
        raise UnreadableFile(
            "not-json", f"{path} is not JSON that can be read: nested too deep, or a number too long."
        ) from error


def _unique_entries(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for name, value in pairs:
        if name in entries:
            fault = Fault(name[:MAX_QUOTED_NAME], "is there twice")
            raise InvalidInput("name-twice", f"The file has two entries named {fault.where} in one object.", [fault])
        entries[name] = value
    return entries


def validate_document(model: type[T], document: Any, typed: str, kind: str) -> T:
    """Instance of a contract model from a parsed document.

    Raises ``InvalidInput`` (``<what>-invalid``) naming every invalid field by its path.
    """
    try:
        return model.model_validate(model.readable_fields(document))
    except ValidationError as error:
        faults = [Fault(field_path(item["loc"], document), item["msg"]) for item in error.errors(include_url=False)]
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        message = f"{typed} is not a {kind}: {faults[0].where}: {faults[0].message}{more}."
        raise InvalidInput(f"{kind}-invalid", message, faults) from error


def field_path(path: Sequence[int | str], document: Any) -> str:
    """Readable path of a field: ``phases[3].contacts[right_foot].position_m[0]``."""
    text, value = "", document
    for part in path:
        if part in _KIND_TAGS:
            continue  # the kind of the surface or element is not part of the path
        value = _child_value(value, part)
        named = isinstance(value, dict) and isinstance(value.get("effector"), str)
        key = value["effector"] if named else part
        text += f"[{key}]" if isinstance(part, int) else f".{part}"
    return text.lstrip(".") or "the file"


def _child_value(value: Any, part: int | str) -> Any:
    try:
        return value[part]
    except (KeyError, IndexError, TypeError):
        return None
