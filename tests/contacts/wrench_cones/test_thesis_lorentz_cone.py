"""The thesis' four steps, what they promise and what they keep."""

import numpy as np
import pytest
from scipy.optimize import minimize

from stridelab.contacts.wrench_cones.contact_points import PointContacts, wrench_transform
from stridelab.contacts.wrench_cones.thesis_lorentz_cone import MIN_PROJECTION, _first_direction, outer_cone
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone
from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotEstimable
from stridelab.reproduction.studies.random_contact_sets import com_m, random_contacts

SOLE = (0.1, 0.06)
FEET = PointContacts.from_placements(
    [(Placement.from_wxyz((0.0, 0.09, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.3, -0.09, 0.15)), SOLE, 0.5)]
)


def about(contacts: PointContacts, point_m: np.ndarray) -> tuple[LinearCone, float]:
    """The linear cone, and how far the thesis' cone about a point stays inside."""
    linear, there = LinearCone.from_contacts(contacts, 4), wrench_transform(-point_m)
    return linear, linear.alpha_max(outer_cone(contacts.wrench_rays() @ there.T).in_frame(there))


def test_it_holds_all_rays_and_touches_one() -> None:
    """(4.17b)."""
    rng = np.random.default_rng(0)
    for k in range(6):
        contacts = random_contacts(rng, 3 + k % 2)
        rays = contacts.wrench_rays() @ wrench_transform(-com_m(contacts)).T
        assert outer_cone(rays).gauge(rays).max() == pytest.approx(1.0, abs=1e-9)


def test_the_first_direction_is_the_nearest_before_which_all_rays_lie() -> None:
    """(4.18) as a general programme, by sequential quadratic programming."""
    rng = np.random.default_rng(1)
    many = np.vstack([rng.normal([3.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.2, (30, 6)), [[-0.2, 1.0, 0.3, 0.0, 0.0, 0.0]]])
    unit = many / np.linalg.norm(many, axis=1, keepdims=True)
    assert (unit @ unit.mean(axis=0)).min() < 0.0  # the mean itself will not do
    d = _first_direction(unit)
    assert (unit @ d).min() > 0.0
    mean = unit.mean(axis=0)
    nearest = minimize(
        lambda x: float(((x - mean) ** 2).sum()),
        unit[-1] + mean,
        constraints={"type": "ineq", "fun": lambda x: unit @ x - MIN_PROJECTION},
        options={"ftol": 1e-14},
    ).x
    np.testing.assert_allclose(d, nearest / np.linalg.norm(nearest), atol=1e-6)


def test_the_circular_cone_exceeds_it() -> None:
    """ "The outer approximation contains the true CWC": of pyramids with four edges only, not of the circle."""
    rays = (contacts := FEET).wrench_rays() @ wrench_transform(-com_m(FEET)).T
    circle = contacts.wrench_rays(32) @ wrench_transform(-com_m(FEET)).T
    assert 1.01 < outer_cone(rays).gauge(circle).max() < 1.2
    around = contacts.wrench_rays(4, "around") @ wrench_transform(-com_m(FEET)).T
    assert outer_cone(around).gauge(circle).max() <= 1.0


def test_alpha_max_is_where_the_cone_leaves() -> None:
    linear, alpha = about(FEET, com_m(FEET))
    there = wrench_transform(-com_m(FEET))
    outer = outer_cone(FEET.wrench_rays() @ there.T).in_frame(there)
    assert linear.violation(outer.shrink(alpha)) == pytest.approx(0.0, abs=1e-9)
    assert linear.violation(outer.shrink(1.01 * alpha)) > 0.0 > linear.violation(outer.shrink(0.99 * alpha))


def test_a_fifth_is_not_safe_and_depends_on_the_point() -> None:
    """4.4.3 guarantees alpha = 1/5; with the centre fixed by step (iv) it is no guarantee."""
    rng = np.random.default_rng(0)
    alphas = [about(contacts, com_m(contacts))[1] for contacts in (random_contacts(rng, 3 + k % 2) for k in range(12))]
    assert min(alphas) < 0.2
    near, far = (about(FEET, com_m(FEET) + np.array([x, 0.0, 0.0]))[1] for x in (0.0, 5.0))
    assert near > 0.25
    assert abs(near - far) > 0.01


def test_two_hands_are_refused() -> None:
    hands = PointContacts.from_placements(
        [(Placement.identity(), None, 0.5), (Placement.from_wxyz((1.0, 0.0, 0.0)), None, 0.5)]
    )
    with pytest.raises(NotEstimable) as raised:
        outer_cone(hands.wrench_rays())
    assert raised.value.code == "thesis-cone-undefined"
