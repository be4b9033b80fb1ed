"""Scenario validation: checks whether a robot can perform a scenario, as in the command line and in jobs.

It takes a few milliseconds of numpy in a thread. Numeric modules are imported on first use, so that the service starts
without them; pinocchio and CasADi are never imported here.
"""

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import anyio

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.robots.card import robot_names
from stridelab.schemas.base import FaultItem, Remark
from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import (
    ContactMargin,
    Course,
    PhaseBody,
    PhaseSupport,
    Scenario,
    ScenarioCheck,
    TerrainCrossing,
)
from stridelab.service.api.problems import MAX_FAULTS
from stridelab.service.api.robots.cache import RobotCache

if TYPE_CHECKING:
    from stridelab.contacts.effector_geometry import EffectorShape
    from stridelab.contacts.validation.static_equilibrium import StaticEquilibrium

CACHE_SIZE: Final = 16


async def validate_scenario(scenario: Scenario, limiter: anyio.CapacityLimiter, robots: RobotCache) -> ScenarioCheck:
    """Validate ``scenario``: faults, margins of the contacts, and support regions.

    For a robot that cannot be loaded, the only fault is the reason.
    """
    reason = await robots.load_problem(scenario.robot) if scenario.robot in robot_names() else None
    if reason is not None:
        return _invalid_check(scenario, FaultItem(where="robot", message=reason))
    shapes = await robots.own_shapes(scenario.robot)
    return await anyio.to_thread.run_sync(validate_sync, scenario, shapes, limiter=limiter)


async def refuse_invalid(scenario: Scenario, limiter: anyio.CapacityLimiter, robots: RobotCache) -> None:
    """Raise ``InvalidInput`` (``scenario-invalid``), naming phase and effector, if the robot cannot perform it."""
    validation = await validate_scenario(scenario, limiter, robots)
    if not validation.valid:
        faults = [Fault(fault.where, fault.message) for fault in validation.errors]
        first = faults[0]
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        raise InvalidInput(
            "scenario-invalid", f"The robot cannot do this: {first.where}: {first.message}{more}.", faults
        )


async def compose_task(course: Course, limiter: anyio.CapacityLimiter, robots: RobotCache) -> PlanContactsInput:
    """Compose a course for its robot. Raises ``NotFound`` (``robot-not-found``) and as ``compose_course`` does."""
    shapes = await robots.own_shapes(course.robot)

    def compose() -> PlanContactsInput:
        from stridelab.pipelines.plan_contacts import compose_course

        return compose_course(course, _robot_effectors(course.robot, shapes))

    return await anyio.to_thread.run_sync(compose, limiter=limiter)


async def compose_crossing_task(
    request: TerrainCrossing, limiter: anyio.CapacityLimiter, robots: RobotCache
) -> PlanContactsInput:
    """Compose the task of a crossing for its robot.

    Raises ``NotFound`` (``robot-not-found``) and as ``compose_crossing`` does.
    """
    shapes = await robots.own_shapes(request.robot)

    def compose_task() -> PlanContactsInput:
        from stridelab.pipelines.plan_contacts import compose_crossing

        return compose_crossing(request, _robot_effectors(request.robot, shapes))

    return await anyio.to_thread.run_sync(compose_task, limiter=limiter)


def validate_sync(scenario: Scenario, own_shapes: Mapping[str, Any] | None = None) -> ScenarioCheck:
    """Validate ``scenario`` in the calling thread, without loading the robot.

    ``own_shapes`` are the stored effectors of a user's robot, None for a bundled one. The last results are cached: an
    editor sends a scenario again until the whole body is checked.
    """
    try:
        _robot_effectors(scenario.robot, own_shapes)
    except StridelabError as error:  # unknown robot or invalid card
        return _invalid_check(scenario, FaultItem(where="robot", message=error.message))
    fields = set(Scenario.model_fields)  # a stored scenario has more
    return _cached_check(
        scenario.model_dump_json(include=fields), None if own_shapes is None else json.dumps(own_shapes)
    )


@lru_cache(maxsize=CACHE_SIZE)
def _cached_check(scenario_json: str, shapes_json: str | None) -> ScenarioCheck:
    from stridelab.contacts.validation.validate import validate_scenario as examine

    scenario = Scenario.model_validate_json(scenario_json)
    effectors = _robot_effectors(scenario.robot, None if shapes_json is None else json.loads(shapes_json))
    report = examine(scenario.model_dump(mode="json"), effectors)
    faults = [FaultItem(where=fault.where, message=fault.message) for fault in report.faults[:MAX_FAULTS]]
    return ScenarioCheck(
        valid=report.valid,
        errors=faults,
        warnings=[Remark(code=remark.code, message=remark.message) for remark in report.remarks],
        margins=[ContactMargin.from_object(margin) for margin in report.margins],
        support_region_m=[list(rest.region_m) for rest in report.rests],
        support=[_phase_support(k, rest) for k, rest in enumerate(report.rests)],
        phases=_unchecked_phases(scenario),
        duration_s=report.duration_s,
    )


def _robot_effectors(robot: str, own_shapes: Mapping[str, Any] | None) -> "Mapping[str, EffectorShape]":
    from stridelab.contacts.effector_geometry import effector_shapes, stored_shapes

    return effector_shapes(robot) if own_shapes is None else stored_shapes(own_shapes)


def _phase_support(k: int, rest: "StaticEquilibrium") -> PhaseSupport:
    if rest.com_m is None:
        return PhaseSupport(phase=k, margin_m=None, com_m=None)
    x, y, z = rest.com_m.tolist()
    return PhaseSupport(phase=k, margin_m=rest.margin_m, com_m=(x, y, z))


def _unchecked_phases(scenario: Scenario) -> list[PhaseBody]:
    return [PhaseBody(phase=k, body="not-asked") for k in range(len(scenario.phases))]


def _invalid_check(scenario: Scenario, fault: FaultItem) -> ScenarioCheck:
    return ScenarioCheck(
        valid=False,
        errors=[fault],
        warnings=[],
        margins=[],
        support_region_m=[[] for _ in scenario.phases],
        support=[PhaseSupport(phase=k, margin_m=None, com_m=None) for k in range(len(scenario.phases))],
        phases=_unchecked_phases(scenario),
        duration_s=math.fsum(phase.duration_s for phase in scenario.phases),
    )
