"""From a scenario of the contract to the problem of a robot: the judge, the robot, its densities."""

from collections.abc import Mapping, Sequence

from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.shapes import effector_shapes
from stridelab.contacts.validation import judge, outline
from stridelab.errors import Fault, InvalidInput
from stridelab.reachability.card import Measure
from stridelab.reachability.proxy import Proxy
from stridelab.reachability.store import load_card, load_proxies, require_same_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.scenarios import Scenario


def checked(scenario: Scenario) -> tuple[ContactSequence, tuple[Remark, ...]]:
    """The contact sequence, and what is worth knowing of it.

    Raises ``InvalidInput`` (``scenario-invalid``), naming phase and effector, and ``NotFound`` (``robot-not-found``).
    """
    report, sequence = judge(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _invalid(report.faults)
    return sequence, tuple(Remark(code=r.code, message=r.message) for r in report.remarks)


def outlined(scenario: Scenario) -> ContactSequence:
    """``checked`` without the remarks, and without asking where the CoM can rest, for whoever waits."""
    faults, sequence = outline(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _invalid(faults)
    return sequence


def _invalid(faults: Sequence[Fault]) -> InvalidInput:
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    message = f"The robot cannot do this: {faults[0].where}: {faults[0].message}{more}."
    return InvalidInput("scenario-invalid", message, faults)


def densities(robot: Robot, measure: Measure) -> Mapping[str, Proxy]:
    """The learned densities, which must be those of this very robot.

    Raises ``Unavailable`` (``reachability-of-another-robot``).
    """
    require_same_robot(load_card(robot.name, measure), robot)
    return load_proxies(robot.name, measure)
