"""From a scenario of the contract to the problem of a robot: the judge, the robot, its densities."""

from collections.abc import Mapping

from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.shapes import effector_shapes
from stridelab.contacts.validation import judge
from stridelab.errors import InvalidInput
from stridelab.reachability.card import Measure
from stridelab.reachability.proxy import Proxy
from stridelab.reachability.store import load_card, load_proxies, require_same_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.scenarios import Scenario


def checked(scenario: Scenario) -> tuple[ContactSequence, tuple[Remark, ...]]:
    """The contact sequence, and what is worth knowing of it.

    Raises ``InvalidInput`` ("scenario-invalid"), naming phase and effector, and ``NotFound`` ("robot-not-found").
    """
    report, sequence = judge(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        first = report.faults[0]
        more = f" and {len(report.faults) - 1} more" if len(report.faults) > 1 else ""
        message = f"The robot cannot do this: {first.where}: {first.message}{more}."
        raise InvalidInput("scenario-invalid", message, report.faults)
    return sequence, tuple(Remark(code=r.code, message=r.message) for r in report.remarks)


def densities(robot: Robot, measure: Measure) -> Mapping[str, Proxy]:
    """The learned densities, which must be those of this very robot.

    Raises ``Unavailable`` ("reachability-of-another-robot").
    """
    require_same_robot(load_card(robot.name, measure), robot)
    return load_proxies(robot.name, measure)
