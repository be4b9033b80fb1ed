"""A scenario from a file or by name; whatever is wrong with it is named as people write it."""

import json
from pathlib import Path
from typing import Any

import pytest

from stridelab.errors import InvalidInput, NotFound, StridelabError, TooLarge, UnreadableFile
from stridelab.pipelines.scenarios.scenario_files import bundled_names, field_path, read_scenario
from stridelab.schemas.scenarios import Scenario
from support.robots.plans import short_walk


def written(folder: Path, content: Any) -> str:
    path = folder / "stairs.json"
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return str(path)


def body() -> dict[str, Any]:
    return short_walk().model_dump(mode="json")


def test_a_file_and_a_bundled_name_are_scenarios(tmp_path: Path) -> None:
    assert read_scenario(written(tmp_path, body())) == short_walk()
    assert {"flat-walk", "long-stride", "six-stairs", "stairs-with-rail"} <= set(bundled_names())
    for name in bundled_names():
        assert isinstance(read_scenario(name), Scenario)


def test_the_file_of_a_stored_scenario_is_a_scenario(tmp_path: Path) -> None:
    stored = {"id": "a", "created_at": "2026-01-01T00:00:00Z", "updated_at": None, "bundled": False, "owner": None}
    assert read_scenario(written(tmp_path, {**body(), **stored})) == short_walk()


def test_a_local_file_takes_precedence_over_a_bundled_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "six-stairs").write_text(short_walk().model_dump_json())
    assert read_scenario("six-stairs") == short_walk()


@pytest.mark.parametrize(
    ("content", "kind", "code", "words"),
    [
        (b"", UnreadableFile, "not-json", "line 1, column 1"),
        (b'{"name": ', UnreadableFile, "not-json", "line 1"),
        (b"\xff\xfe\x00", UnreadableFile, "not-json", "UTF-8"),
        (b"[" * 100_000, UnreadableFile, "not-json", "nested too deep"),
        (b" " * 1_000_001, TooLarge, "file-too-large", "1000000 bytes"),
        (b"[]", InvalidInput, "scenario-invalid", "the file"),
        (b"{}", InvalidInput, "scenario-invalid", "name"),
    ],
)
def test_an_invalid_scenario_is_refused_in_one_sentence(
    tmp_path: Path, content: bytes, kind: type[StridelabError], code: str, words: str
) -> None:
    with pytest.raises(kind) as refusal:
        read_scenario(written(tmp_path, content))
    assert refusal.value.code == code
    assert words in refusal.value.message


def test_an_unknown_name_lists_the_bundled_scenarios() -> None:
    with pytest.raises(NotFound) as refusal:
        read_scenario("seven-stairs")
    assert refusal.value.code == "scenario-not-found"
    assert "six-stairs" in refusal.value.message


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile) as refusal:
        read_scenario(str(tmp_path))
    assert refusal.value.code == "file-not-readable"


def test_faults_name_phase_effector_and_field(tmp_path: Path) -> None:
    wrong = body()
    wrong["phases"][1]["contacts"][0]["position_m"][2] = "high"
    wrong["phases"][2]["duration_s"] = None
    wrong["terrain"][0]["size_m"] = [1, 2]
    effector = wrong["phases"][1]["contacts"][0]["effector"]
    with pytest.raises(InvalidInput) as refusal:
        read_scenario(written(tmp_path, wrong))
    places = {fault.where for fault in refusal.value.faults}
    assert f"phases[1].contacts[{effector}].position_m[2]" in places
    assert "phases[2].duration_s" in places
    assert any(where.startswith("terrain[0].size_m") for where in places)
    assert refusal.value.faults[0].where in refusal.value.message


def test_a_contact_without_effector_is_counted() -> None:
    document = {"phases": [{"contacts": [{}, {"effector": "left_foot"}]}]}
    assert field_path(("phases", 0, "contacts", 0, "effector"), document) == "phases[0].contacts[0].effector"
    assert (
        field_path(("phases", 0, "contacts", 1, "position_m", 2), document)
        == "phases[0].contacts[left_foot].position_m[2]"
    )
    assert field_path((), document) == "the file"
