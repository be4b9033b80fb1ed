"""No MATLAB runs here: the HTTP calls of its example are read from the script and carried out."""

import re
from pathlib import Path
from typing import Any

import httpx
import pytest

from support.docs.matlab import Web, run

SCRIPT = Path(__file__).parents[2] / "docs" / "examples" / "from_matlab.m"


def described(http: httpx.Client, service_url: str, method: str, url: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The description of a call, and all schemas."""
    openapi = http.get(f"{service_url}/api/v1/openapi.json").json()
    path = url.removeprefix(service_url)
    for template, methods in openapi["paths"].items():
        if method.lower() in methods and re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), path):
            return methods[method.lower()], openapi["components"]["schemas"]
    raise AssertionError(f"the service describes no {method} {path}")


def fields_of(operation: dict[str, Any], schemas: dict[str, Any]) -> set[str]:
    """Names that the body of a call may have."""
    if "requestBody" not in operation:
        return set()
    (media,) = operation["requestBody"]["content"].values()
    schema = media["schema"]
    return set(schemas[schema["$ref"].rpartition("/")[2]]["properties"] if "$ref" in schema else schema["properties"])


def test_every_call_is_described_and_the_script_comes_to_its_end(folder: Path, service_url: str) -> None:
    (folder / "com.csv").unlink(missing_ok=True)
    with httpx.Client(timeout=90.0) as http:
        web = Web(http, folder)
        names = run(SCRIPT.read_text(encoding="utf-8"), web.functions(), {"api": f"{service_url}/api/v1"})
        for method, url, query, body in web.calls:
            operation, schemas = described(http, service_url, method, url)
            assert query <= {parameter["name"] for parameter in operation.get("parameters", [])}
            assert body <= fields_of(operation, schemas)
    methods = [method for method, *_ in web.calls]
    assert methods[:3] == ["POST", "POST", "GET"]
    assert len(methods) >= 5
    assert names["result"]["summary"]["method"] == "smoother"
    assert names["recording"]["subject"]["sex"] == "female"
    assert len(names["com"]["sd_z_m"]) == 400


def test_the_script_calls_the_address_of_make_serve() -> None:
    assert "api = 'http://127.0.0.1:8000/api/v1';" in SCRIPT.read_text(encoding="utf-8")


@pytest.mark.parametrize("line", ["x = mystery(1);", "x = 1", "x = a + b;"])
def test_unknown_matlab_functions_are_refused(line: str, tmp_path: Path) -> None:
    with httpx.Client() as http, pytest.raises((AssertionError, KeyError)):
        run(line, Web(http, tmp_path).functions(), {})
