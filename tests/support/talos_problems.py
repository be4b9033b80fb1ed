"""The centroidal problems of the bundled scenarios for TALOS."""

import json

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.contacts.scenario_json import sequence_of
from stridelab.contacts.shapes import effector_shapes
from stridelab.reachability.store import load_proxies
from stridelab.resources import models_dir
from stridelab.robots.loader import load_robot

COM_HEIGHT_M = 0.86


def bundled(scenario: str) -> CentroidalProblem:
    """Rest to rest over a scenario of ``models/scenarios``, with the bundled proxies."""
    robot = load_robot("talos")
    text = (models_dir() / "scenarios" / f"{scenario}.json").read_text(encoding="utf-8")
    sequence = sequence_of(json.loads(text), effector_shapes("talos"))
    start, end = (standing_com_m(sequence.phases[i].contacts, COM_HEIGHT_M, robot.effectors) for i in (0, -1))
    return CentroidalProblem(sequence, robot.mass_kg, robot.effectors, load_proxies("talos"), start, end)
