"""Options of a replay: validation against robot and scenario, and translation to disturbances and an estimator.

Importing this module is cheap: the API validates requests with it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stridelab.errors import Fault, InvalidInput
from stridelab.robots.card import robot_card
from stridelab.robots.data_files import data_files
from stridelab.schemas.plans import ReplayOptions

if TYPE_CHECKING:
    from stridelab.robots.robot import Robot
    from stridelab.wholebody.replay.disturbances import Disturbances
    from stridelab.wholebody.replay.sensors import StateObserver


def require_pushes(
    replay: bool | ReplayOptions, robot: str, duration_s: float, links: Sequence[str] | None = None
) -> None:
    """Raise ``InvalidInput`` (``replay-invalid``) for pushes after the motion of ``duration_s`` or on unknown links.

    ``links`` None are those of the installed description; then also raises as ``robot_card`` and ``data_files`` do.
    """
    if not isinstance(replay, ReplayOptions) or not replay.pushes:
        return
    links = link_names(robot) if links is None else links
    faults = []
    for k, push in enumerate(replay.pushes):
        if push.time_s > duration_s:
            message = f"{push.time_s:g} s is after the end of the motion, which lasts {duration_s:.6g} s"
            faults.append(Fault(f"replay.pushes.{k}.time_s", message))
        if push.link is not None and push.link not in links:
            message = f"{robot} has no link {push.link[:60]!r}; its links are {', '.join(links)}"
            faults.append(Fault(f"replay.pushes.{k}.link", message))
    if faults:
        places = ", ".join(fault.where for fault in faults)
        raise InvalidInput("replay-invalid", f"Not every push fits the robot and its motion: see {places}.", faults)


def link_names(robot: str) -> tuple[str, ...]:
    """All links of the description of a robot. Raises as ``robot_card`` and ``data_files`` do."""
    root = ET.parse(data_files(robot_card(robot)).urdf).getroot()  # noqa: S314 (the loader has validated it)
    return tuple(link.attrib["name"] for link in root.iter("link"))


def disturbances_of(options: ReplayOptions) -> "Disturbances":
    """Disturbances of a replay; the delay is that of joint control and stabiliser."""
    from stridelab.pipelines.replays.replay_estimation import LOW_NOISE
    from stridelab.wholebody.replay.disturbances import Disturbances, Push

    return Disturbances(
        friction=options.friction,
        delay_s=options.delay_s,
        joint_delay_s=options.delay_s,
        trunk_mass_kg=options.payload_kg,
        pushes=tuple(Push(one.time_s, one.impulse_ns, link=one.link) for one in options.pushes),
        sensor_noise=LOW_NOISE if options.sensors == "estimated" else None,
    )


def observer_of(options: ReplayOptions, robot: "Robot") -> "StateObserver":
    """State estimator of a replay: none, or the filter of kinematics and forces."""
    from stridelab.pipelines.replays.replay_estimation import LOW_NOISE, FilteredCom
    from stridelab.wholebody.replay.sensors import as_sensed

    return FilteredCom(robot, LOW_NOISE.position_m) if options.sensors == "estimated" else as_sensed
