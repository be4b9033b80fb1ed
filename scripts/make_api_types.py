"""Write the types of what the pages' scripts read of the HTTP interface: ``frontend/types/api.d.ts``.

Usage: scripts/make_api_types.py [--check]. With ``--check`` nothing is written, and the exit status is 1 where the
file on disk differs. Types come from the OpenAPI description of the service; an answer has every field of its model,
and tuples are arrays.
"""

import argparse
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings

TARGET: Final = Path(__file__).parents[1] / "frontend" / "types" / "api.d.ts"
READ: Final = ("Job", "JobResult", "LiveSession", "LiveStreams", "PlanPreview", "Problem", "ScenarioCheck")
"""Schemas that scripts read by name; those that they contain are added."""
HEADING: Final = """\
// Written by scripts/make_api_types.py from the OpenAPI description of the service: edit the models there.

declare namespace Api {
"""
LINE: Final = 120
REFERENCE: Final = "#/components/schemas/"
PRIMITIVES: Final = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}

Schema = Mapping[str, Any]


def api_types(schemas: Mapping[str, Schema]) -> str:
    """The declarations of the schemas ``READ`` of an OpenAPI description, and of those they contain."""
    names, waiting = set(), list(READ)
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting += re.findall(rf"{REFERENCE}(\w+)", repr(schemas[name]))
    return HEADING + "\n".join(_interface_text(name, schemas[name]) for name in sorted(names)) + "}\n"


def _interface_text(name: str, schema: Schema) -> str:
    fields = "".join(_field_line(field, _type_of(one)) for field, one in schema.get("properties", {}).items())
    return f"  interface {name} {{\n{fields}  }}\n"


def _field_line(name: str, type_name: str) -> str:
    line = f"    {name}: {type_name};\n"
    return line if len(line) <= LINE else line.replace(" | ", "\n      | ").replace(": ", ":\n      | ", 1)


def _type_of(schema: Schema) -> str:
    if "$ref" in schema:
        return str(schema["$ref"]).removeprefix(REFERENCE)
    if "const" in schema or "enum" in schema:
        return " | ".join(f'"{value}"' for value in schema.get("enum", [schema.get("const")]))
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return " | ".join(dict.fromkeys(_type_of(one) for one in schema[union]))
    if schema.get("type") == "array":
        return _array_of(dict.fromkeys(_member_types(schema)))
    if schema.get("type") == "object":
        values = schema.get("additionalProperties")
        return f"Record<string, {_type_of(values) if isinstance(values, Mapping) else 'any'}>"
    return PRIMITIVES.get(schema.get("type", ""), "any")


def _member_types(schema: Schema) -> Iterator[str]:
    for one in schema.get("prefixItems", [schema.get("items", {})]):
        yield _type_of(one)


def _array_of(members: Mapping[str, None]) -> str:
    inside = " | ".join(members)
    return f"({inside})[]" if " | " in inside else f"{inside}[]"


def main() -> None:
    """Write the file, or compare it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    text = api_types(create_app(Settings()).openapi()["components"]["schemas"])
    if not parser.parse_args().check:
        TARGET.write_text(text)
    elif TARGET.read_text() != text:
        sys.exit("frontend/types/api.d.ts is not current: run scripts/make_api_types.py")


if __name__ == "__main__":
    main()
