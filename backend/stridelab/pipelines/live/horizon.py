"""What the control of a live robot has in mind: the path of its CoM and the next footholds.

While the plan is followed, they are the plan's. A steered walk is predicted by the linear inverted pendulum of rate w
over the chosen and the following footholds, with the pressure p in the middle of the standing sole:

    xi(t) = p + exp(-w dt) (xi(t + dt) - p) ,     c' = w (xi - c) .
"""

import math
from typing import Final

import numpy as np

from stridelab.conventions import Vector3
from stridelab.wholebody.recovery.walking import Foothold, WalkRun
from stridelab.wholebody.replay.dcm_feedback import pendulum_rate
from stridelab.wholebody.replay.stepper import ReplayStepper

HORIZON_S: Final = 2.5
INTERVAL_S: Final = 0.1
STEPS: Final = 4


def predict_horizon(stepper: ReplayStepper) -> tuple[list[Vector3], tuple[Foothold, ...]]:
    """Positions of the CoM every ``INTERVAL_S`` from now on, and the next footholds; none while the robot recovers."""
    recovering = stepper.recovering
    if recovering is None:
        return _planned_path(stepper), _planned_footholds(stepper)
    if isinstance(recovering, WalkRun):
        footholds = recovering.predict_footholds(STEPS)
        return (_pendulum_path(stepper, recovering, footholds) if recovering.is_walking else []), footholds
    return [], ()


def _planned_path(stepper: ReplayStepper) -> list[Vector3]:
    motion, i = stepper.motion, stepper.sample_index
    every, n = round(INTERVAL_S * motion.rate_hz), round(HORIZON_S * motion.rate_hz)
    return list(motion.com_reference_m[i : i + n + 1 : every])


def _planned_footholds(stepper: ReplayStepper) -> tuple[Foothold, ...]:
    sequence, now_s = stepper.motion.sequence, float(stepper.motion.time_s[stepper.sample_index])
    first, last = sequence.phase_at(now_s), sequence.phase_at(now_s + HORIZON_S)
    footholds: list[Foothold] = []
    for k in range(first, last):
        before, after = sequence.phases[k].contacts, sequence.phases[k + 1].contacts
        for name, contact in after.items():
            if name not in before and contact.kind == "surface":
                R = contact.placement.rotation
                footholds.append(Foothold(name, contact.placement.position_m, math.atan2(R[1, 0], R[0, 0])))
    return tuple(footholds)


def _pendulum_path(stepper: ReplayStepper, walk: WalkRun, footholds: tuple[Foothold, ...]) -> list[Vector3]:
    """The CoM follows the capture point, which follows backwards from rest at the last foothold."""
    com_m, _ = stepper.simulation.com_state()
    ground_m = float(footholds[0].position_m[2]) if footholds else 0.0
    decay = math.exp(-pendulum_rate(float(com_m[2]) - ground_m) * INTERVAL_S)
    pressures = walk.predict_pressures(footholds)
    times_s = np.arange(round(HORIZON_S / INTERVAL_S)) * INTERVAL_S
    p = [next((place for until_s, place in pressures if t < until_s), pressures[-1][1]) for t in times_s]
    xi = [p[-1]]
    for place in reversed(p):
        xi.append(place + decay * (xi[-1] - place))
    path = [com_m]
    for capture_m in reversed(xi[:-1]):
        here = path[-1].copy()
        here[:2] = capture_m + decay * (here[:2] - capture_m)
        path.append(here)
    return path
