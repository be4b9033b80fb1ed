"""The centroidal problems of the bundled scenarios."""

import json
from dataclasses import replace
from typing import Any

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.resting import from_rest_to_rest
from stridelab.contacts.scenario_json import sequence_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.shapes import effector_shapes
from stridelab.reachability.store import load_proxies
from stridelab.resources import models_dir
from stridelab.robots.loader import load_robot

COM_HEIGHT_M = 0.86


def bundled(scenario: str, **settings: Any) -> CentroidalProblem:
    """TALOS from rest to rest over a scenario of ``models/scenarios``, with the bundled proxies."""
    robot, sequence = load_robot("talos"), _sequence(scenario, "talos")
    start, end = (standing_com_m(sequence.phases[i].contacts, COM_HEIGHT_M, robot.effectors) for i in (0, -1))
    problem = CentroidalProblem(sequence, robot.mass_kg, robot.effectors, load_proxies("talos"), start, end)
    return replace(problem, **settings)


def rail_of_hrp2(**settings: Any) -> CentroidalProblem:
    """The third experiment for HRP-2."""
    sequence = _sequence("stairs-with-rail-hrp2", "hrp2")
    return replace(from_rest_to_rest(load_robot("hrp2"), sequence, load_proxies("hrp2")), **settings)


def _sequence(scenario: str, robot: str) -> ContactSequence:
    text = (models_dir() / "scenarios" / f"{scenario}.json").read_text(encoding="utf-8")
    return sequence_of(json.loads(text), effector_shapes(robot))
