"""What goes wrong silently between plates, axis and filter, in numbers; docs/theory/pitfalls.md."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.dynamics.wrench import Wrench, central_axis, com_acceleration, total_wrench, zmp_of_wrench
from stridelab.estimation.complementary.forward_backward import (
    FilterState,
    filter_inputs,
    forward_backward,
    forward_pass,
    initial_state,
)
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Plate, Recording, Subject, Window
from support.recordings.analytic_motions import Harmonics, Motion, uniform, walk

WALK = walk()
UP = np.array([0.0, 0.0, 1.0])
GEOMETRY_SD_M = 0.02


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


def test_block_means_shift_the_force_by_half_a_block():
    t = np.arange(1500) / 1500.0
    ramp = np.tile(t[:, None], (1, 3))  # a force that tells its own time
    blocks = ramp.reshape(100, 15, 3).mean(axis=1)
    frames = np.arange(100) / 100.0
    shift_s = blocks[:, 0] - frames
    assert_allclose(shift_s, 7 / 1500)
    assert 1.2 * shift_s[0] == pytest.approx(0.0056)  # metres at 1.2 m/s
    plate = Plate(1, 2, np.zeros((4, 3)), ramp, ramp, np.zeros(3))
    recording = Recording({"a": np.zeros((100, 3))}, 100.0, 1500.0, (plate,), Subject(), (), "+z", None)
    read = wrench_track(recording, (Window(0.0, 1.0),)).force_n[:, 0]
    assert_allclose(read[10:90], frames[10:90], atol=1e-6)


@pytest.mark.parametrize(("low_hz", "high_hz", "wrong_for_s"), [(0.4, 4.0, 0.3), (0.2, 1.0, 1.2)])
def test_zero_states_throw_the_height_away(low_hz: float, high_hz: float, wrong_for_s: float):
    t = np.arange(0.0, 9.2, 0.005)
    still = Motion(Harmonics(np.array([0.0, 0.0, 0.83]), np.zeros(3)))
    filters = complementary_filters(low_hz, high_hz, 200.0)
    inputs = filter_inputs(still.com.at(t), Wrench(still.force(t), still.moment(t)), still.mass_kg)
    zero = FilterState(*(np.zeros((2, 3)),) * 3)
    error = forward_pass(filters, inputs, zero)[:, 2] - 0.83
    assert np.abs(error).max() > 0.7
    assert t[np.abs(error) > 0.001].max() > wrong_for_s
    assert rms(error) > 0.025  # metres, over all 9.2 s
    assert_allclose(forward_pass(filters, inputs, initial_state(filters, inputs)), still.com.at(t), atol=1e-9)


def test_the_offset_of_the_axis_must_start_at_its_mean_and_the_edge_is_five_time_constants_long():
    """The table errs by 20 mm sideways. From zero the correction needs 5 tau_2 = 2 s, and so does every edge."""
    t = np.arange(0.0, 9.2, 0.005)
    filters = complementary_filters(0.4, 4.0, 200.0)
    coasting = uniform()
    g = coasting.com.at(t) + np.array([0.0, 0.02, 0.0])
    inputs = filter_inputs(g, Wrench(coasting.force(t), coasting.moment(t)), coasting.mass_kg)
    at_mean = initial_state(filters, inputs)
    at_zero = FilterState(at_mean.h2, at_mean.s2_h2, np.zeros((2, 3)))
    late = np.abs(forward_pass(filters, inputs, at_zero) - coasting.com.at(t))[:, 1]
    assert late[[100, 200, 400]] == pytest.approx([0.0128, 0.0057, 0.0008], abs=3e-4)  # after 0.5, 1 and 2 s
    assert_allclose(forward_pass(filters, inputs, at_mean)[:, 1], coasting.com.at(t)[:, 1], atol=1e-9)
    assert_allclose(forward_backward(filters, inputs)[:, 1], coasting.com.at(t)[:, 1], atol=1e-9)


def test_the_filters_pass_a_line_exactly_so_positions_may_start_anywhere():
    t = np.arange(0.0, 2.0, 0.005)
    filters, coasting = complementary_filters(0.4, 4.0, 200.0), uniform()
    inputs = filter_inputs(coasting.com.at(t), Wrench(coasting.force(t), coasting.moment(t)), coasting.mass_kg)
    assert_allclose(forward_backward(filters, inputs), coasting.com.at(t), atol=1e-9)


def test_projecting_the_noisy_geometry_gives_c_p_its_error_along_the_force():
    random, t = np.random.default_rng(0), np.arange(0.0, 5.0, 0.005)
    error = GEOMETRY_SD_M * random.standard_normal((len(t), 3))
    c, f = WALK.com.at(t), WALK.force(t)
    c_p = central_axis(Wrench(f, np.cross(c, f))).project(c + error)
    n = f / np.linalg.norm(f, axis=1, keepdims=True)
    assert_allclose(np.sum((c_p - c) * n, axis=1), np.sum(error * n, axis=1), atol=1e-12)
    assert np.corrcoef((c_p - c)[:, 2], error[:, 2])[0, 1] > 0.98  # "c_p measures z": it repeats the geometry
    assert rms(c_p - c)[:2].max() < 0.2 * GEOMETRY_SD_M  # the force leans
    # taken for two independent measurements, the mean of both is believed to be better by sqrt(2); it is not
    mean = (c_p + c + error) / 2 - c
    assert rms(mean)[2] / GEOMETRY_SD_M == pytest.approx(1.0, abs=0.05)


def test_a_foot_beside_the_plates_moves_the_axis_by_decimetres():
    feet = np.array([[[0.3, 0.1, 0.0]], [[-0.3, -0.1, 0.0]]])
    force = np.tile([[[0.0, 0.0, 350.0]]], (2, 1, 1))
    both = total_wrench(feet, force, np.zeros_like(feet))
    one = total_wrench(feet[:1], force[:1], np.zeros_like(feet[:1]))
    com = np.array([[0.0, 0.0, 0.9]])
    assert_allclose(central_axis(both).project(com), com, atol=1e-12)
    assert np.linalg.norm(central_axis(one).project(com) - com) == pytest.approx(np.hypot(0.3, 0.1))
    assert com_acceleration(one.force_n, 700 / 9.81)[0, 2] == pytest.approx(-9.81 / 2)  # and half a free fall


def test_two_feet_on_one_plate_are_one_wrench_with_a_pressure_under_neither():
    feet = np.array([[[0.3, 0.1, 0.0]], [[-0.3, -0.1, 0.0]]])
    force = np.tile([[[0.0, 0.0, 350.0]]], (2, 1, 1))
    plate = total_wrench(feet, force, np.zeros_like(feet))
    pressure = zmp_of_wrench(plate, np.zeros(3), UP)[0]
    assert np.linalg.norm(pressure - feet[:, 0], axis=1).min() > 0.3  # no contact is at the centre of pressure
    com = np.array([[0.0, 0.0, 0.9]])
    assert_allclose(central_axis(plate).project(com), com, atol=1e-12)  # the sum is all that (2.5) asks for


def test_a_light_contact_has_no_axis_and_the_threshold_is_on_the_norm():
    random = np.random.default_rng(0)
    c = np.tile([[0.0, 0.0, 0.9]], (2000, 1))
    noise = 3.0 * random.standard_normal((2000, 3))  # Nm

    def scatter_m(size_n: float) -> float:
        f = np.tile([[0.0, 0.0, size_n]], (2000, 1))
        axis = central_axis(Wrench(f, np.cross(c, f) + noise), threshold_n=1.0)
        return float(rms(axis.project(c) - c)[:2].max())

    assert scatter_m(20.0) == pytest.approx(0.15, rel=0.05)
    assert scatter_m(700.0) == pytest.approx(0.0043, rel=0.05)
    leaning = np.array([[300.0, 0.0, 5.0]])  # a hand against a wall: f_z says nothing, |f| does
    axis = central_axis(Wrench(leaning, np.cross(c[:1], leaning)))
    assert axis.defined.all()
    assert_allclose(axis.project(c[:1]), c[:1], atol=1e-12)


def test_moments_at_the_plate_in_nmm_are_not_moments_at_the_origin_in_nm():
    plate, foot = np.array([3.0, 0.4, 0.0]), np.array([3.05, 0.45, 0.0])
    force = np.array([[0.0, 0.0, 700.0]])
    at_plate_nmm = 1000.0 * np.cross(foot - plate, force)
    above_foot = np.array([[3.05, 0.45, 0.9]])

    def miss_m(moment_nm: np.ndarray) -> float:
        return float(np.linalg.norm(central_axis(Wrench(force, moment_nm)).project(above_foot) - above_foot))

    assert miss_m(at_plate_nmm / 1000 + np.cross(plate, force)) < 1e-12
    assert miss_m(at_plate_nmm / 1000) == pytest.approx(np.hypot(3.0, 0.4))  # not carried to the origin
    assert miss_m(at_plate_nmm + np.cross(plate, force)) > 70  # metres
