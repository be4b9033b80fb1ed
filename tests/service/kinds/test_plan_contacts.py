"""``plan-contacts``: the job returns a scenario of the contract that the judge and ``plan-motion`` take."""

from pathlib import Path
from typing import Any

import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.errors import InvalidInput, NotEstimable, NotFound
from stridelab.pipelines import plan_contacts as pipeline
from stridelab.schemas.plans import PlanContactsSummary, PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.plan_contacts.run import run
from stridelab.service.kinds.registry import KINDS
from stridelab.service.processes.child import with_json
from support.command_line import quiet
from support.robots.scenario_bodies import box, feet, planks, task


def task_input(**change: Any) -> dict[str, Any]:
    return {"input": task([box("floor", (-1.0, 2.0), 0.0)], 0.8, 0.0) | change}


def test_the_registry_names_it() -> None:
    assert KINDS["plan-contacts"].run == f"{run.__module__}:{run.__name__}"


def test_the_scenario_can_be_planned(tmp_path: Path) -> None:
    outcome = with_json(run)(task_input(name="To the door"), tmp_path, quiet)
    summary = PlanContactsSummary.model_validate(outcome["summary"])
    assert (summary.scenario.name, summary.steps, summary.scenario.robot) == ("To the door", 4, "talos")
    assert validate_scenario(summary.scenario.model_dump(mode="json"), effector_shapes("talos")).valid
    written = Scenario.model_validate_json((tmp_path / "scenario.json").read_text(encoding="utf-8"))
    assert written == summary.scenario
    assert PlanMotionInput(scenario=written).scenario == written
    assert outcome["artifacts"] == [{"name": "scenario.json", "media_type": "application/json"}]


@pytest.mark.parametrize("robot", ["talos", "hrp2", "g1"])
def test_every_robot_walks(robot: str, tmp_path: Path) -> None:
    outcome = with_json(run)(task_input(robot=robot), tmp_path, quiet)
    scenario = PlanContactsSummary.model_validate(outcome["summary"]).scenario
    assert validate_scenario(scenario.model_dump(mode="json"), effector_shapes(robot)).valid


@pytest.mark.parametrize(
    ("task_", "error", "code"),
    [
        (task_input(start={"contacts": feet(0.0, 0.4)}), InvalidInput, "stance-invalid"),
        ({"input": planks(0.6)}, NotEstimable, "contacts-unreachable"),
        (task_input(robot="nao"), NotFound, "robot-not-found"),
    ],
)
def test_what_cannot_be_planned_is_refused_and_leaves_nothing(
    task_: dict[str, Any], error: type[Exception], code: str, tmp_path: Path
) -> None:
    with pytest.raises(error) as refusal:
        with_json(run)(task_, tmp_path, quiet)
    assert getattr(refusal.value, "code", None) == code
    assert list(tmp_path.iterdir()) == []


def certified(
    monkeypatch: pytest.MonkeyPatch, folder: Path, answers: list[tuple[str, int | None]], most: int = 3
) -> tuple[PlanContactsSummary, list[Scenario]]:
    """Summary of a plan whose certificates are ``answers``, and the scenarios that were certified."""
    tried: list[Scenario] = []

    def certify(scenario: Scenario, _progress: object) -> tuple[str, int | None]:
        tried.append(scenario)
        return answers[len(tried) - 1]

    monkeypatch.setattr(pipeline, "_certificate_failure", certify)
    outcome = with_json(run)(task_input(certify=most), folder, quiet)
    return PlanContactsSummary.model_validate(outcome["summary"]), tried


def test_the_step_at_which_a_certificate_fails_is_avoided(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    summary, tried = certified(monkeypatch, tmp_path, [("self_collision_pairs", 2), ("", None)])
    assert (summary.certified, summary.failures) == (True, ["phases[2]: self_collision_pairs"])
    assert summary.scenario == tried[1]
    assert tried[0].phases != tried[1].phases


def test_without_a_certified_plan_the_first_one_is_returned(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    summary, tried = certified(monkeypatch, tmp_path, [("com_error_max", 1), ("com_error_max", 1)], most=2)
    assert (summary.certified, len(summary.failures), len(tried)) == (False, 2, 2)
    assert summary.scenario == tried[0]


def test_a_failure_without_a_phase_ends_the_search(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    summary, tried = certified(monkeypatch, tmp_path, [("plan-not-converged: no solution", None)])
    assert (summary.certified, summary.failures, len(tried)) == (False, ["plan-not-converged: no solution"], 1)


def test_without_the_request_no_motion_is_computed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    summary, tried = certified(monkeypatch, tmp_path, [], most=0)
    assert (summary.certified, summary.failures, tried) == (None, [], [])
