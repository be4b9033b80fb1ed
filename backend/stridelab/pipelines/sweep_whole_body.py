"""Whether the whole body can follow the plan of a scenario of a sweep."""

from collections.abc import Mapping
from dataclasses import replace

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import StridelabError
from stridelab.pipelines.plan_centroidal import solve_centroidal
from stridelab.pipelines.plan_problem import control_of
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.momentum_consistency import agree


def find_whole_body_failure(
    robot: Robot, proxies: Mapping[str, Proxy], sequence: ContactSequence, request: PlanMotionInput
) -> str:
    """Reason why the whole-body motion of ``plan-motion`` fails; empty if its certificate passes."""
    control = control_of(request)
    bounds = PathBounds(None, hand_bounds_n(robot, sequence) if control.has_point_forces else {})
    posed = from_rest_to_rest(robot, sequence, proxies)
    problem = replace(posed, control=control, bounds=bounds, node_rate_hz=request.node_rate_hz)
    try:
        problem, plan = solve_centroidal(problem, request, lambda _fraction, _message: None)
        agreed = agree(robot, problem, plan, solve, WholeBodyController().run)
    except StridelabError as error:
        return error.message
    certificate = certify(robot, sequence, agreed.plan, proxies, agreed.motion)
    failed = [f"{one.name} {one.value:.3g} {one.unit}" for one in certificate.checks if not one.passed]
    return f"The certificate fails: {', '.join(failed)}." if failed else ""
