"""Plan a climb of chapter 4 without a service: where the feet go on a staircase, then how the centre of mass moves.

The staircase is made here; only the first and the last stance are given. ``stridelab plan`` goes on from here to the
whole body, its certificate and a replay in physics.
"""

from dataclasses import replace

import numpy as np

from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import TALOS, both_feet, ground
from stridelab.contacts.scenarios.stairs import Stairs
from stridelab.reachability.planner_limits import planner_limits
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot

stairs = Stairs(number=2, height_m=0.10, depth_m=0.30)
task = {
    "robot": "talos",
    "name": "Two stairs",
    "terrain": [ground(), *stairs.ascending_boxes(TALOS)],
    "start": {"contacts": list(both_feet(TALOS, 0.0, 0.0).values())},
    "goal": {"contacts": list(both_feet(TALOS, *stairs.foothold(2)).values())},
}

shapes = effector_shapes("talos")
contacts = ContactPlanner(shapes, planner_limits("talos")).plan(task)
print(f"{contacts.steps} steps, found in {contacts.solve_time_s:.1f} s")
for number, phase in enumerate(contacts.scenario["phases"]):
    standing = ", ".join(f"{c['effector']} at {np.round(c['position_m'], 2)}" for c in phase["contacts"])
    print(f"  phase {number} for {phase['duration_s']:.1f} s: {standing}")

sequence = sequence_of(contacts.scenario, shapes)
problem = from_rest_to_rest(load_robot("talos"), sequence, load_proxies("talos"))
plan = solve(replace(problem, control=CircularCones()))  # exact friction cones; in C++ where that solver is built
print(f"{plan.solver}: {'converged' if plan.converged else plan.status} in {plan.iterations} iterations")
print(f"the centre of mass goes from {plan.com_m[0].round(3)} to {plan.com_m[-1].round(3)}")
print(f"checked anew by plain arithmetic: the dynamics hold to {plan.verification.dynamics_gap:.0e}")
