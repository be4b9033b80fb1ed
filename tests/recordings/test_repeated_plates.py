"""Plates that repeat the force of others, as the virtual plates of a treadmill do, are not added to it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.plate_contacts import vertical_force_n
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Plate
from stridelab.recordings.repeated_plates import without_repeated
from support.recordings.c3d_files import PlateChannels, write_file

TIME_S = np.arange(3000) / 1000.0


def plate(
    index: int,
    centre_m: tuple[float, float],
    sides_m: tuple[float, float],
    load: np.ndarray,
    ahead_m: np.ndarray | None = None,
) -> Plate:
    """A plate that is loaded in its middle, or as far ahead of it as ``ahead_m``."""
    x, y = 0.5 * np.array(sides_m)
    corners = np.array([[x, y, 0.0], [-x, y, 0.0], [-x, -y, 0.0], [x, -y, 0.0]]) + np.array([*centre_m, 0.0])
    force = np.column_stack([0.1 * load, -0.02 * load, load])
    pressure = np.tile(corners.mean(axis=0), (len(load), 1))
    pressure[:, 1] += 0.0 if ahead_m is None else ahead_m
    return Plate(index, 2, corners, force, np.cross(pressure, force), np.zeros(3))


def feet() -> tuple[np.ndarray, np.ndarray]:
    left = 700.0 * np.clip(0.5 + np.sin(2.0 * np.pi * TIME_S), 0.0, 1.0)
    return left, 700.0 - left


def treadmill(noise_n: float = 3.0) -> list[Plate]:
    """Its two belts one behind the other; the left and the right foot; both together, on the whole treadmill."""
    left, right = feet()
    front = 700.0 * np.clip(0.5 + 0.6 * np.cos(2.0 * np.pi * TIME_S), 0.0, 1.0)
    ahead_m = 0.4 * (2.0 * front - 700.0) / 700.0
    made = [
        plate(1, (0.0, 0.0), (0.6, 1.4), left, ahead_m),
        plate(2, (0.0, 0.0), (0.6, 1.4), right, ahead_m),
        plate(3, (0.0, 0.4), (0.6, 0.7), front),
        plate(4, (0.0, -0.4), (0.6, 0.7), 700.0 - front),
        plate(5, (0.0, 0.0), (0.6, 1.4), left + right, ahead_m),
    ]
    rng = np.random.default_rng(2)
    return [replace(one, force_n=one.force_n + noise_n * rng.normal(size=one.force_n.shape)) for one in made]


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 2, 0, 3, 1)])
@pytest.mark.parametrize(
    ("present", "used"),
    [((1, 2, 3, 4), {3, 4}), ((1, 2, 3, 4, 5), {5}), ((1, 2, 5), {5}), ((3, 4, 5), {5}), ((3, 4), {3, 4})],
)
def test_the_force_counts_once(present: tuple[int, ...], used: set[int], order: tuple[int, ...]) -> None:
    made = [treadmill()[i] for i in order]
    plates, remarks = without_repeated([one for one in made if one.index in present])
    assert {one.index for one in plates if one.use} == used
    assert [remark.code for remark in remarks] == ["plates-repeated"] * (set(present) != used)
    total = sum(one.force_n[:, 2] for one in plates if one.use)
    assert np.mean(total) == pytest.approx(700.0, abs=2.0)


def test_plates_over_each_other_with_forces_of_their_own_are_all_used() -> None:
    """The left and the right foot on one treadmill; and a plate whose force is its own by a fifth."""
    left, right = treadmill()[:2]
    assert without_repeated([left, right]) == ((left, right), ())
    other = replace(left, index=3, force_n=left.force_n * [1.0, 1.0, 1.2])
    assert without_repeated([left, right, other])[1] == ()


def test_plates_beside_each_other_with_the_same_force_are_all_used() -> None:
    """Who stands evenly on two plates, or on feet whose contacts overlap, loads both alike, not in one place."""
    load = np.full(3000, 350.0) + np.sin(TIME_S)
    for apart_m, kind in ((0.41, 2), (0.1, CONTACT_TYPE)):
        one, other = plate(1, (0.0, 0.0), (0.4, 0.6), load), plate(2, (apart_m, 0.0), (0.4, 0.6), load)
        pair = replace(one, type=kind), replace(other, type=kind)
        assert without_repeated(pair) == (pair, ())
    off = [replace(each, use=each.index < 3) for each in treadmill()]
    assert without_repeated(off) == (tuple(off), ())


def test_a_repetition_that_lacks_a_step_is_one() -> None:
    front, back, whole = treadmill()[2:]
    lacking = replace(front, force_n=front.force_n.copy(), moment_nm=front.moment_nm.copy(), index=6)
    lacking.force_n[:500], lacking.moment_nm[:500] = 0.0, 0.0
    plates, _ = without_repeated([front, back, lacking, replace(back, index=7), whole])
    assert [each.index for each in plates if each.use] == [5]


def test_contacts_of_a_force_file_may_repeat_each_other_too() -> None:
    left, right, whole = treadmill()[0], treadmill()[1], treadmill()[4]
    plates, _ = without_repeated([replace(each, type=CONTACT_TYPE) for each in (left, right, whole)])
    assert [each.index for each in plates if each.use] == [5]


def test_a_file_with_the_force_of_a_treadmill_twice_is_read_once(tmp_path: Path) -> None:
    made = [one for one in treadmill() if one.index in (1, 2, 5)]
    channels = []
    for one in made:
        signals = np.column_stack(
            [one.force_n, 1000.0 * (one.moment_nm - np.cross(one.corners_m.mean(0), one.force_n))]
        )
        channels.append(PlateChannels(2, -signals, 1000.0 * one.corners_m))
    points = {f"M{i}": np.random.default_rng(i).normal(900.0, 300.0, (300, 3)) for i in range(4)}
    recording = read_recording(write_file(tmp_path / "treadmill.c3d", points, plates=channels))
    assert [one.use for one in recording.plates] == [False, False, True]
    assert np.mean(vertical_force_n(recording)) == pytest.approx(700.0, abs=5.0)
    (message,) = [remark.message for remark in recording.remarks if remark.code == "plates-repeated"]
    assert message == "Plates 1, 2 lie over plates 3 and repeat their force; they are not used."
