"""The interface from its own description: every endpoint with what it takes and answers, and every model with units."""

import json
from functools import cache
from typing import Any

from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings

UNITS = {
    "m": "m", "mm": "mm", "s": "s", "ms": "ms", "hz": "Hz", "kg": "kg", "n": "N", "nm": "N m", "nms": "N m s",
    "rad": "rad", "rad_s": "rad/s", "m_s": "m/s", "m_s2": "m/s^2", "m_s3": "m/s^3", "m3": "m^3", "mb": "MB",
}  # fmt: skip
"""By the end of a field's name."""
HEAD = """# Every endpoint

Made of the service's own description, which a running one gives at `/api/v1/openapi.json`; the
[HTTP interface](../http-api.md) tells how they go together. Bodies and answers are JSON unless said otherwise; their
models are [on a page of their own](models.md). Units are those of the field's name.
"""


@cache
def description() -> dict[str, Any]:
    """The OpenAPI document; the settings are those of nobody."""
    return create_app(Settings()).openapi()


def shown(name: str) -> str:
    """A model's name as people read it: ``Page[Job]`` is a page of them."""
    title = description()["components"]["schemas"][name].get("title", name)
    return str(title).replace("[", " of ").rstrip("]")


def linked(name: str, models: str) -> str:
    """A model's name, leading to it."""
    return f"[{shown(name)}]({models}#{shown(name).lower().replace(' ', '-')})"


def cell(text: object) -> str:
    """A text inside of a table."""
    return " ".join(str(text).replace("``", "`").replace("|", "\\|").split())


def unit(name: str) -> str:
    """Unit at the end of a name: ``height_m`` is in m."""
    ends = (name.split("_", k)[-1] for k in range(1, name.count("_") + 1))
    return next((UNITS[end] for end in ends if end in UNITS), "")


def kind(schema: dict[str, Any], models: str) -> str:
    """A type in words, with links to models; ``models`` is the page that they are on."""
    if "$ref" in schema:
        return linked(schema["$ref"].rpartition("/")[2], models)
    if parts := schema.get("anyOf") or schema.get("oneOf") or schema.get("allOf"):
        return " or ".join(dict.fromkeys(kind(part, models) for part in parts))
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if "prefixItems" in schema:
        return "[" + ", ".join(kind(part, models) for part in schema["prefixItems"]) + "]"
    if schema.get("type") == "array":
        count = schema.get("minItems")
        many = f"{count} " if count and count == schema.get("maxItems") else ""
        return f"list of {many}{kind(schema.get('items', {}), models)}"
    if schema.get("type") == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"object of {kind(schema['additionalProperties'], models)} by name"
    what = schema.get("format") or schema.get("type", "anything")
    return str(what) + limits(schema)


def limits(schema: dict[str, Any]) -> str:
    """Least and largest value or length."""
    words = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    texts = [f"{sign} {schema[key]:g}" for key, sign in words.items() if key in schema]
    texts += [
        f"{sign} {schema[key]} characters" for key, sign in (("minLength", ">="), ("maxLength", "<=")) if key in schema
    ]
    return f" {', '.join(texts)}" if texts else ""


def fields_table(schema: dict[str, Any], models: str) -> list[str]:
    """Fields of an object: type, unit, default, and the meaning where any has one of its own."""
    if not schema.get("properties"):
        return []
    explained = any("description" in field for field in schema["properties"].values())
    lines = ["| field | type | unit | default |", "| --- | --- | --- | --- |"]
    if explained:
        lines = ["| field | type | unit | default | meaning |", "| --- | --- | --- | --- | --- |"]
    for name, field in schema["properties"].items():
        default = "required" if name in schema.get("required", []) else f"`{json.dumps(field.get('default'))}`"
        if len(default) > 60:
            default = "see there"
        row = f"| `{name}` | {cell(kind(field, models))} | {unit(name)} | {cell(default)} |"
        lines.append(f"{row} {cell(field.get('description', ''))} |" if explained else row)
    return [*lines, ""]


def paragraphs(text: str) -> str:
    """Prose of a docstring: double backticks become single ones."""
    return text.replace("``", "`").strip()


def operation_lines(method: str, path: str, operation: dict[str, Any]) -> list[str]:
    """One endpoint."""
    lines = [
        f"### {method.upper()} {path}",
        "",
        paragraphs(operation.get("description") or operation.get("summary", "")),
        "",
    ]
    if parameters := operation.get("parameters"):
        lines += ["| parameter | in | type | default | meaning |", "| --- | --- | --- | --- | --- |"]
        for p in parameters:
            default = "required" if p.get("required") else f"`{json.dumps(p['schema'].get('default'))}`"
            what = cell(kind(p["schema"], "models.md"))
            lines.append(f"| `{p['name']}` | {p['in']} | {what} | {default} | {cell(p.get('description', ''))} |")
        lines.append("")
    for media, content in operation.get("requestBody", {}).get("content", {}).items():
        schema = content["schema"]
        named = kind(schema, "models.md") if "$ref" in schema else "these fields"
        lines += [f"Takes `{media}`: {named}.", ""]
        target = (
            description()["components"]["schemas"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
        )
        lines += fields_table(target, "models.md")
    lines += ["| answer | when | what |", "| --- | --- | --- |"]
    for status, answer in sorted(operation["responses"].items()):
        kinds = [f"{kind(c.get('schema', {}), 'models.md')}" for c in answer.get("content", {}).values()]
        media = ", ".join(
            f"`{m}`" for m in answer.get("content", {}) if m not in {"application/json", "application/problem+json"}
        )
        lines.append(f"| {status} | {cell(answer['description'])} | {cell('; '.join(kinds))} {media} |")
    return [*lines, ""]


def endpoints_page() -> str:
    """All endpoints, those of one room together."""
    rooms: dict[str, list[str]] = {}
    for path, methods in description()["paths"].items():
        for method, operation in methods.items():
            rooms.setdefault(operation["tags"][0], []).extend(operation_lines(method, path, operation))
    return "\n".join(
        [HEAD, *(line for room, lines in sorted(rooms.items()) for line in (f"## {room.capitalize()}", "", *lines))]
    )


def models_page() -> str:
    """All models."""
    lines = ["# Every model", "", "What goes in and comes out of the [endpoints](endpoints.md), field by field.", ""]
    for name, schema in sorted(description()["components"]["schemas"].items()):
        lines += [f"## {shown(name)}", "", paragraphs(schema.get("description", "")), "", *fields_table(schema, "")]
        if not schema.get("properties"):
            lines += [kind(schema, ""), ""]
    return "\n".join(lines)
