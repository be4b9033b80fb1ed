"""Leans of a standing shank before a riser, against the distance of a whole posture."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Stairs, climb, flat_walk
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.leg_stretch import LegModel
from stridelab.wholebody.shank_lean import RISER_GAP_M, ShankLean


def distance_m(talos: Robot, sequence: ContactSequence, lean_rad: float) -> float:
    """Distance of the left shank from the first stair, in a posture whose left ankle leans it by ``lean_rad``."""
    model, data, effector = talos.model, talos.model.createData(), talos.effectors["left_foot"]
    frame = model.getFrameId(effector.frame)
    knee, ankle = list(model.supports[model.frames[frame].parentJoint])[-3:-1]
    q = talos.q_reference.copy()
    for _ in range(2):  # the lean is linear in the angle of the ankle
        pin.framesForwardKinematics(model, data, q)
        contact = data.oMf[frame] * to_se3(effector.T_frame_contact)
        x, _, z = contact.rotation.T @ (data.oMi[knee].translation - data.oMi[ankle].translation)
        axis = contact.rotation.T @ data.oMi[ankle].rotation @ np.array([0.0, 1.0, 0.0])
        q[model.joints[ankle].idx_q] -= float(axis[1]) * (lean_rad - np.arctan2(x, z))
    pin.framesForwardKinematics(model, data, q)
    at = to_se3(sequence.phases[0].contacts["left_foot"].placement)
    moved = at * (data.oMf[frame] * to_se3(effector.T_frame_contact)).inverse()
    stair = next(one for one in sequence.terrain.surfaces if one.name == "stair 1")
    assert isinstance(stair, Box)
    place, distances = to_se3(stair.placement), []
    for part in talos.full_collision.geometryObjects:
        if part.parentJoint == knee:
            one = moved * data.oMi[knee] * part.placement
            transforms = [coal.Transform3s(there.rotation, there.translation) for there in (one, place)]
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            box = coal.Box(*stair.size_m.tolist())
            distances.append(coal.distance(part.geometry, transforms[0], box, transforms[1], request, result))
    return min(distances)


@pytest.mark.parametrize(("height_m", "gap_m"), [(0.15, 0.05), (0.18, 0.06)])
def test_a_shank_leans_until_it_is_near_the_riser(talos: Robot, height_m: float, gap_m: float) -> None:
    stairs = climb(Stairs(2, height_m, 0.3, toe_gap_m=gap_m), Timing(1.5, 1.0, 0.2))
    sequence = sequence_of(stairs, effector_shapes("talos"))
    leg = LegModel.of_robot(talos).legs["left_foot"]
    contact = sequence.phases[0].contacts["left_foot"]
    lean_rad = ShankLean(talos, sequence).largest_lean_rad("left_foot", contact, 0, leg.ankle_m, leg.tilt_max_rad)
    assert 0.3 < lean_rad < leg.tilt_max_rad
    assert distance_m(talos, sequence, lean_rad) == pytest.approx(RISER_GAP_M, abs=1e-3)


def test_on_level_ground_the_ankle_alone_limits_the_lean(talos: Robot) -> None:
    sequence = sequence_of(flat_walk(2), effector_shapes("talos"))
    leg, contact = LegModel.of_robot(talos).legs["left_foot"], sequence.phases[0].contacts["left_foot"]
    assert ShankLean(talos, sequence).largest_lean_rad("left_foot", contact, 0, leg.ankle_m, 1.0) == 1.0
