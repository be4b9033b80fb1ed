"""SE(3): group laws, and pinocchio as the independent implementation."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stridelab.dynamics.spatial import Placement

seeds = st.integers(min_value=0, max_value=2**32 - 1)


def random_placement(seed: int) -> tuple[Placement, pin.SE3]:
    rng = np.random.default_rng(seed)
    wxyz, position = rng.normal(size=4), rng.uniform(-3, 3, size=3)
    w, x, y, z = wxyz / np.linalg.norm(wxyz)
    return Placement.from_wxyz(position.tolist(), wxyz.tolist()), pin.SE3(pin.Quaternion(w, x, y, z).matrix(), position)


def same(ours: Placement, theirs: pin.SE3) -> bool:
    return np.allclose(ours.rotation, theirs.rotation, atol=1e-12) and np.allclose(
        ours.position_m, theirs.translation, atol=1e-12
    )


@given(seeds, seeds)
def test_composition_inverse_and_action_equal_pinocchios(first: int, second: int) -> None:
    a, A = random_placement(first)
    b, B = random_placement(second)
    assert same(a, A)
    assert same(a @ b, A * B)
    assert same(a.inverse(), A.inverse())
    points = np.random.default_rng(first).normal(size=(5, 3))
    assert np.allclose(a.act(points), [A.act(point) for point in points], atol=1e-12)


@given(seeds)
def test_a_placement_survives_its_quaternion(seed: int) -> None:
    a, _ = random_placement(seed)
    again = Placement.from_wxyz(a.position_m.tolist(), a.wxyz.tolist())
    assert np.allclose(again.rotation, a.rotation, atol=1e-12)
    assert a.wxyz[0] >= 0
    assert np.linalg.norm(a.wxyz) == pytest.approx(1.0, abs=1e-12)


@given(seeds)
def test_a_placement_and_its_inverse_cancel(seed: int) -> None:
    a, _ = random_placement(seed)
    nothing = a @ a.inverse()
    assert np.allclose(nothing.rotation, Placement.identity().rotation, atol=1e-12)
    assert np.allclose(nothing.position_m, 0.0, atol=1e-12)


def test_the_length_of_a_quaternion_does_not_matter_and_zero_is_refused() -> None:
    assert np.allclose(
        Placement.from_wxyz([0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 2.0]).rotation,
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        atol=1e-12,
    )
    with pytest.raises(ValueError, match="zero norm"):
        Placement.from_wxyz([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0])
