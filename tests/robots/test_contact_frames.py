"""Contact frames sit where the effectors say, and the shared model is left alone."""

import numpy as np
import pinocchio as pin

from stridelab.dynamics.spatial import Placement
from stridelab.robots.contact_frames import to_se3, with_contact_frames
from stridelab.robots.loader import load_robot


def test_every_effector_has_its_contact_frame() -> None:
    talos = load_robot("talos")
    frames_before = talos.model.nframes
    model, index = with_contact_frames(talos)
    assert talos.model.nframes == frames_before
    assert set(index) == set(talos.effectors)
    rng = np.random.default_rng(0)
    q = pin.integrate(model, talos.q_reference, rng.normal(size=model.nv))
    data, plain = model.createData(), talos.model.createData()
    pin.framesForwardKinematics(model, data, q)
    pin.framesForwardKinematics(talos.model, plain, q)
    for name, effector in talos.effectors.items():
        link = plain.oMf[talos.model.getFrameId(effector.frame)]
        T_world_link = Placement(link.translation.copy(), link.rotation.copy())
        expected = T_world_link @ effector.T_frame_contact
        here = data.oMf[index[name]]
        assert np.allclose(here.translation, expected.position_m)
        assert np.allclose(here.rotation, expected.rotation)


def test_placements_are_converted_to_pinocchio() -> None:
    place = Placement.from_wxyz([1.0, 2.0, 3.0], (0.5, 0.5, -0.5, 0.5))
    assert np.allclose(to_se3(place).act(np.array([0.1, 0.2, 0.3])), place.act(np.array([[0.1, 0.2, 0.3]]))[0])
