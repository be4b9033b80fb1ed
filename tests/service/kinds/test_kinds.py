"""The registry is light, consistent, and its references resolve; it finds folders, which have all that is shown."""

import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.provenance import bibtex_of, known_references, software_versions
from stridelab.service.kinds.registry import KINDS, PARSE_UPLOAD, discover_kinds


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_run_is_an_importable_function(kind) -> None:
    module, _, function = kind.run.partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    assert KINDS[kind.name] is kind


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_every_kind_has_a_title_a_description_and_examples(kind) -> None:
    assert kind.title[0].isupper()
    assert kind.description[0].isupper()
    assert kind.description.endswith(".")
    assert bool(kind.examples) == kind.offered
    for example in kind.examples.values():
        assert example["summary"]
        kind.input_model.model_validate(example["value"])


@pytest.fixture
def package_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., ModuleType]:
    """A function that makes a package with these files."""

    def make_package(name: str, **files: str) -> ModuleType:
        for path, text in files.items():
            file = tmp_path / name / f"{path.replace('__', '/')}.py"
            file.parent.mkdir(parents=True, exist_ok=True)
            (file.parent / "__init__.py").touch()
            file.write_text(text)
        (tmp_path / name / "__init__.py").touch()
        monkeypatch.syspath_prepend(tmp_path)
        return importlib.import_module(name)

    return make_package


KIND = "from support.service import job_kinds\nKIND = job_kinds.kind({!r}, 'write_outcome')\n".format


def test_a_folder_is_a_kind_if_it_has_a_kind_module(package_of: Callable[..., ModuleType]) -> None:
    package = package_of("some_kinds", weigh_walk__kind=KIND("weigh-walk"), add_up__kind=KIND("add-up"), tools__run="")
    assert list(discover_kinds(package)) == ["add-up", "weigh-walk"]


def test_a_kind_has_the_name_of_its_folder(package_of: Callable[..., ModuleType]) -> None:
    with pytest.raises(ValueError, match=r"weigh .* way"):
        discover_kinds(package_of("odd_kinds", weigh__kind=KIND("way")))


def test_the_upload_parser_is_an_importable_function() -> None:
    module, _, function = PARSE_UPLOAD.partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_web_server_and_worker_import_no_numeric_package() -> None:
    """Only the child pays for numpy and friends."""
    code = (
        "import sys, stridelab.service.kinds.registry, stridelab.service.api.app, stridelab.service.jobs.worker;"
        "print(sorted({'numpy', 'scipy', 'ezc3d', 'pinocchio', 'pyarrow'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_an_outcome_survives_the_transfer_from_the_child() -> None:
    outcome = Outcome({"a": [1.0, None]}, ("dumas2007",), (ArtifactFile("com.csv", "text/csv"),))
    assert outcome.to_json() == {
        "summary": {"a": [1.0, None]},
        "references": ["dumas2007"],
        "artifacts": [{"name": "com.csv", "media_type": "text/csv"}],
    }


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
