"""The base turns with the feet, smoothly."""

import numpy as np
import pytest

from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.wholebody.control.tasks import Heading

FEET = ("left_foot", "right_foot")


def turned(name: str, yaw: float) -> Contact:
    return Contact(
        name, Placement.from_wxyz([0.0, 0.0, 0.0], (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))), "ground", 0.5
    )


def turning() -> Heading:
    """The right foot, then the left one, turn by 0.4 rad from 3 rad on, past the seam at pi."""
    start = {name: turned(name, 3.0) for name in FEET}
    right = {**start, "right_foot": turned("right_foot", 3.4)}
    end = {**right, "left_foot": turned("left_foot", 3.4)}
    air = [{"left_foot": start["left_foot"]}, {"right_foot": right["right_foot"]}]
    phases = tuple(ContactPhase(0.5, contacts) for contacts in (start, air[0], right, air[1], end))
    return Heading.of_sequence(ContactSequence("turn", "talos", 0.5, Terrain.from_surfaces([]), phases))


def test_it_follows_the_mean_of_the_feet_without_a_jump() -> None:
    assert np.allclose(turning().yaw_rad, [3.0, 3.0, 3.2, 3.2, 3.4, 3.4])


@pytest.mark.parametrize("time_s", [0.6, 0.75, 0.9, 1.7])
def test_its_rates_are_derivatives(time_s: float) -> None:
    heading, h = turning(), 1e-5
    phase = np.full(3, heading.sequence.phase_at(time_s))
    R, w, w_rate = heading.orientations_at(phase, time_s + h * np.array([-1.0, 0.0, 1.0]))
    before, yaw, after = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3))
    assert w[1, 2] == pytest.approx((after - before) / (2 * h), abs=1e-6)
    assert w_rate[1, 2] == pytest.approx((after - 2 * yaw + before) / h**2, abs=1e-3)
    assert np.all(w[:, :2] == 0.0)
