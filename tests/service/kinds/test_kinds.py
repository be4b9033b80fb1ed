"""The registry is light, consistent, and its references resolve."""

import importlib
import subprocess
import sys

import pytest

from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.registry import KINDS, PARSE_UPLOAD
from stridelab.service.kinds.result_tables import bibtex_of, known_references, software_versions


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_run_is_an_importable_function(kind) -> None:
    module, _, function = kind.run.partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    assert KINDS[kind.name] is kind


def test_the_upload_parser_is_an_importable_function() -> None:
    module, _, function = PARSE_UPLOAD.partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_importing_the_registry_imports_no_numeric_package() -> None:
    """The API and the worker import it; only the child pays for numpy and friends."""
    code = (
        "import sys, stridelab.service.kinds.registry;"
        "print(sorted({'numpy', 'scipy', 'ezc3d', 'pinocchio', 'pyarrow'} & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_an_outcome_survives_the_way_out_of_the_child() -> None:
    outcome = Outcome({"a": [1.0, None]}, ("dumas2007",), (ArtifactFile("com.csv", "text/csv"),))
    assert Outcome.from_json(outcome.to_json()) == outcome


def test_bibliography_gives_whole_entries_once_and_refuses_unknown_keys() -> None:
    text = bibtex_of(["dumas2007", "carpentier2017thesis", "dumas2007"])
    assert text.count("@") == 2
    assert "Adjustments to {McConville}" in text
    assert text.count("{") == text.count("}")
    with pytest.raises(KeyError):
        bibtex_of(["nobody1900"])


def test_every_reference_entry_is_complete() -> None:
    for key in known_references():
        entry = bibtex_of([key])
        assert all(f" {field}" in entry for field in ("author", "title", "year")), key


def test_versions_name_python_and_the_packages() -> None:
    assert software_versions()["python"] == ".".join(map(str, sys.version_info[:3]))
    assert software_versions()["stridelab"] != "not installed"
