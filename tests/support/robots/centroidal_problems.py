"""Problems of the centroidal stage over the sequences made by hand.

The centroidal problems of the bundled scenarios.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_proxies
from stridelab.resources import models_dir
from stridelab.robots.loader import load_robot
from support.robots.sequences import COM_HEIGHT_M, EFFECTORS, MASS_KG, PROXIES, foot, phase, sequence


def rest_to_rest(
    walk: ContactSequence, proxies: Mapping[str, Proxy] = PROXIES, height_m: float = COM_HEIGHT_M, **settings: Any
) -> CentroidalProblem:
    """From standing over the first phase to standing over the last."""
    start, end = (standing_com_m(walk.phases[i].contacts, height_m, EFFECTORS) for i in (0, -1))
    return CentroidalProblem(walk, MASS_KG, EFFECTORS, proxies, start, end, **settings)


def with_a_contact_between(**settings: Any) -> CentroidalProblem:
    """Two steps: the right foot's first landing is neither the start nor the goal."""
    left, right, ahead, far = foot("left", 0.0), foot("right", 0.0), foot("right", 0.25), foot("left", 0.45)
    walk = sequence(
        phase(0.6, left, right),
        phase(0.8, left),
        phase(0.4, left, ahead),
        phase(0.8, ahead),
        phase(0.4, far, ahead),
        phase(0.8, far),
        phase(0.8, far, foot("right", 0.45)),
    )
    return rest_to_rest(walk, **settings)


TALOS_COM_HEIGHT_M = 0.86


def bundled(scenario: str, **settings: Any) -> CentroidalProblem:
    """TALOS from rest to rest over a scenario of ``models/scenarios``, with the bundled proxies."""
    robot, sequence = load_robot("talos"), _sequence(scenario, "talos")
    start, end = (standing_com_m(sequence.phases[i].contacts, TALOS_COM_HEIGHT_M, robot.effectors) for i in (0, -1))
    problem = CentroidalProblem(sequence, robot.mass_kg, robot.effectors, load_proxies("talos"), start, end)
    return replace(problem, **settings)


def rail_of_hrp2(**settings: Any) -> CentroidalProblem:
    """The third experiment for HRP-2."""
    sequence = _sequence("stairs-with-rail-hrp2", "hrp2")
    return replace(from_rest_to_rest(load_robot("hrp2"), sequence, load_proxies("hrp2")), **settings)


def _sequence(scenario: str, robot: str) -> ContactSequence:
    text = (models_dir() / "scenarios" / f"{scenario}.json").read_text(encoding="utf-8")
    return sequence_of(json.loads(text), effector_shapes(robot))
