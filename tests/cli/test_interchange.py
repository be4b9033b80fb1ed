"""``stridelab export-contacts`` and ``import-contacts``: there and back by files; bad files leave nothing behind."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.contacts import MAX_DOCUMENT_BYTES
from stridelab.cli.results import EXIT_CODES
from stridelab.errors import Conflict, InvalidInput, NotFound, StridelabError, TooLarge, UnreadableFile
from stridelab.pipelines.scenarios.scenario_files import bundled_names, read_scenario

Document = dict[str, Any]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def typed(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def refused(kind: type[StridelabError], *arguments: str) -> str:
    before = sorted(Path().iterdir())
    code, output = typed(*arguments)
    assert code == EXIT_CODES[kind], output
    assert sorted(Path().iterdir()) == before, "something was left behind"
    return output


def exported(name: str = "stairs-with-rail") -> Document:
    typed("export-contacts", name, "--out-file", "exported.json")
    document: Document = json.loads(Path("exported.json").read_text(encoding="utf-8"))
    Path("exported.json").unlink()
    return document


def bad(document: object) -> str:
    Path("bad.json").write_text(json.dumps(document), encoding="utf-8")
    return "bad.json"


@pytest.mark.parametrize("name", bundled_names())
def test_a_scenario_exported_and_imported_is_the_same(name: str) -> None:
    code, output = typed("export-contacts", name)
    assert code == 0, output
    code, output = typed("import-contacts", f"{name}.contacts.json")
    assert code == 0, output
    assert f"stridelab plan {name}.scenario.json" in output
    was, now = read_scenario(name), read_scenario(f"{name}.scenario.json")
    assert (now.name, now.robot, now.friction, now.description) == (was.name, was.robot, was.friction, was.description)
    assert now.start_com_height_m == was.start_com_height_m
    assert [p.duration_s for p in now.phases] == pytest.approx([p.duration_s for p in was.phases])
    for one, other in zip(was.phases, now.phases, strict=True):
        assert [(c.effector, c.position_m) for c in one.contacts] == [
            (c.effector, c.position_m) for c in other.contacts
        ]


def test_missing_fields_of_other_tools_are_taken_from_a_scenario_beside() -> None:
    document = exported("six-stairs")
    del document["stridelab"]
    bare = bad(document)
    message = refused(InvalidInput, "import-contacts", bare)
    assert "robot" in message
    assert "terrain" in message
    code, output = typed("import-contacts", bare, "--beside", "six-stairs")
    assert code == 0, output
    assert read_scenario("bad.scenario.json").terrain == read_scenario("six-stairs").terrain
    message = refused(NotFound, "import-contacts", bare, "--beside", "seven-stairs", "--force")
    assert "seven-stairs" in message


def test_a_file_is_replaced_only_with_force() -> None:
    Path("mine.json").write_text("mine", encoding="utf-8")
    refused(Conflict, "export-contacts", "flat-walk", "--out-file", "mine.json")
    assert Path("mine.json").read_text(encoding="utf-8") == "mine"
    code, _ = typed("export-contacts", "flat-walk", "--out-file", "mine.json", "--force")
    assert code == 0
    assert json.loads(Path("mine.json").read_text(encoding="utf-8"))["contact_phases"]
    Path("folder").mkdir()
    refused(Conflict, "export-contacts", "flat-walk", "--out-file", "folder", "--force")
    refused(InvalidInput, "export-contacts", "flat-walk", "--out-file", "mine.json/below.json")


def test_an_infeasible_scenario_is_not_exported() -> None:
    scenario = read_scenario("flat-walk").model_dump(mode="json")
    scenario["phases"][0]["contacts"][0]["position_m"][2] += 0.2
    message = refused(InvalidInput, "export-contacts", bad(scenario))
    assert f"phases[0].contacts[{scenario['phases'][0]['contacts'][0]['effector']}]" in message


@pytest.mark.parametrize(
    ("content", "kind", "word"),
    [
        (b"contacts", UnreadableFile, "not-json"),
        (b"", UnreadableFile, "not-json"),
        (b"\xff\xfe", UnreadableFile, "UTF-8"),
        (b"[" * 100_000, UnreadableFile, "nested too deep"),
        (b" " * (MAX_DOCUMENT_BYTES + 1), TooLarge, "file-too-large"),
        (b"[1, 2]", InvalidInput, "contact_phases"),
        (b"null", InvalidInput, "contact_phases"),
        (b"{}", InvalidInput, "there are no phases"),
        (b'{"contact_phases": [{"t_init": 1e400, "t_final": -1e400}]}', InvalidInput, "phases[0]"),
        (b'{"contact_phases": [{"t_init": 0, "t_final": 1' + b"0" * 400 + b"}]}", InvalidInput, "phases[0]"),
    ],
)
def test_an_invalid_document_is_refused_in_one_line(content: bytes, kind: type[StridelabError], word: str) -> None:
    Path("bad.json").write_bytes(content)
    message = refused(kind, "import-contacts", "bad.json", "--beside", "flat-walk")
    assert word in message
    assert "Traceback" not in message
    refused(UnreadableFile, "import-contacts", "nowhere.json")


def test_two_patches_of_one_effector_are_refused() -> None:
    document = json.dumps(exported())
    Path("bad.json").write_text(document.replace('"right_foot": {', '"left_foot": {', 1), encoding="utf-8")
    message = refused(InvalidInput, "import-contacts", "bad.json")
    assert "left_foot: is there twice" in message


def phase(change: Document) -> Callable[[Document], None]:
    return lambda made: made["contact_phases"][2].update(change)


def place(change: Document) -> Callable[[Document], None]:
    return lambda made: made["contact_phases"][2]["contact_patches"]["left_foot"]["placement"].update(change)


def around(change: Document) -> Callable[[Document], None]:
    return lambda made: made["stridelab"].update(change)


def tail(made: Document) -> None:
    third = made["contact_phases"][2]
    third["effector_in_contact"].append("tail")
    third["contact_patches"]["tail"] = third["contact_patches"]["left_foot"]


def many(made: Document) -> None:
    first = made["contact_phases"][0]
    made["contact_phases"] = [{**first, "t_init": float(k), "t_final": k + 1.0} for k in range(500)]


@pytest.mark.parametrize(
    ("change", "where", "word"),
    [
        (phase({"t_init": 3.0}), "phases[2]", "overlaps phase 1"),
        (phase({"t_init": float("nan")}), "phases[2]", "finite"),
        (phase({"effector_in_contact": 5}), "phases[2].effector_in_contact", "list"),
        (phase({"effector_in_contact": ["left_foot"] * 2}), "phases[2].contacts[left_foot]", "twice"),
        (phase({"effector_in_contact": ["x" * 10_000]}), f"phases[2].contacts[{'x' * 60}]", "no patch"),
        (tail, "phases[2].contacts[tail]", "no effector"),
        (place({"translation": [0.0, float("nan"), 0.0]}), "phases[2].contacts[left_foot]", "finite"),
        (place({"translation": [0.0, 0.0, 10**400]}), "phases[2].contacts[left_foot]", "large"),
        (place({"translation": [0.0, 0.09, 0.3]}), "phases[2].contacts[left_foot]", ""),
        (place({"translation": [0.0, 0.09, 1e6]}), "phases[2].contacts[left_foot]", "100"),
        (around({"friction": 0.0}), "phases[0].contacts[left_foot]", "above 0"),
        (around({"robot": "nobody"}), "", "nobody"),
        (around({"terrain": "floor"}), "terrain", ""),
        (around({"wheels": 4}), "wheels", "not permitted"),
        (many, "phases", "400"),
    ],
)
def test_an_impossible_choice_is_named_and_nothing_is_written(
    change: Callable[[Document], None], where: str, word: str
) -> None:
    document = exported()
    change(document)
    message = refused(
        NotFound if word == "nobody" else InvalidInput, "import-contacts", bad(document), "--out-file", "made.json"
    )
    assert where in message.replace("\n", "")
    assert word in message
