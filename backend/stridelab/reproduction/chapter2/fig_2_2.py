"""Figure 2.2: zero-moment point and central axis on a simulated walk with exact wrench."""

from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Points, Progress, Series
from stridelab.dynamics.wrench import Wrench, central_axis, transport, zmp_linearised, zmp_of_motion, zmp_of_wrench
from stridelab.reproduction.claims import Measured, Reproduction, at_least, at_most, reproduces
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.reproduction.studies.estimator_study import simulate_trial
from stridelab.simulation.ground_truth import TrueMotion

UP: Final = np.array([0.0, 0.0, 1.0])
ORIGIN: Final = np.zeros(3)


@reproduces("fig-2.2", "Zero-moment point and central axis")
def run(seeds: range, tell: Progress) -> Reproduction:
    """One walk without noise; deterministic."""
    tell(0.1, "simulating a walk")
    truth = simulate_trial("robot", "none", 0).truth
    wrench = Wrench(truth.force_n, truth.moment_nm)
    f, c = truth.force_n, truth.com_m
    tell(0.7, "placing the axes")
    z = zmp_of_wrench(wrench, ORIGIN, UP)
    cart = zmp_linearised(c, truth.acceleration_m_s2)
    axis = central_axis(wrench)
    n = axis.direction
    # Intersection of the axis with the floor.
    foot = axis.point_m - (axis.point_m[:, 2] / n[:, 2])[:, None] * n

    motion_zmp = zmp_of_motion(c, truth.acceleration_m_s2, truth.momentum_rate_nm, truth.mass_kg)
    exact, printed = float(np.abs(motion_zmp - z[:, :2]).max()), _rms_norm(_printed_2_8(truth) - z[:, :2])
    cart_distance = np.linalg.norm(cart - z[:, :2], axis=1)
    to_cart = c - np.column_stack([cart, np.zeros(len(c))])
    cart_force = np.column_stack([truth.acceleration_m_s2[:, :2], np.full(len(c), GRAVITY_M_S2)])
    distance_error = float(np.abs(np.linalg.norm((foot - z)[:, :2], axis=1) - _predicted_gap(wrench, z)).max())
    cart_angle, axis_angle = (float(_angle_between(u, v).max()) for u, v in ((to_cart, cart_force), (n, f)))
    moment_ratio = _least_moment_ratio(wrench, axis.point_m)
    claims = (
        Measured("zmp_2_8_corrected_m", 0.0, exact, "m", at_most(1e-6, "words")).says(
            "(2.8) is the ZMP of the motion", "With L' of the x axis and the signs that follow from (2.6) and (2.7)."
        ),
        Measured("zmp_2_8_printed_m", 0.0, printed, "m", at_most(1e-6, "words", otherwise="thesis_in_error")).says(
            "(2.8) as printed is the ZMP of the motion",
            "Its second row contains L' about z instead of L' about x (docs/theory/misprints.md).",
        ),
        Measured("cart_line_angle_rad", 0.0, cart_angle, "rad", at_most(1e-6, "words")).says(
            "the line from the ZMP to the CoM of the cart-table is parallel to the contact force",
            f"For the force of the cart-table model. The force of the walk deviates from this line by up to "
            f"{np.degrees(_angle_between(to_cart, f).max()):.2f} degrees, because the height is not constant.",
        ),
        Measured("axis_angle_rad", 0.0, axis_angle, "rad", at_most(1e-6, "words")).says(
            "the central axis is parallel to the contact force"
        ),
        Measured("least_moment_ratio", 1.0, moment_ratio, "1", at_least(1.0 - 1e-9, "words")).says(
            "the central axis is the line of minimum moment norm",
            "Smallest moment norm at 1 cm from the axis, over eight directions, relative to that on the axis.",
        ),
        Measured("theorem_1_m", 0.0, distance_error, "m", at_most(1e-6, "words")).says(
            "theorem 1: the two axes intersect the floor in the same point only without free moment or tilt",
            f"Largest deviation of the distance from |(tau n) x f| / f^2 of the free moment tau at the ZMP, projected "
            f"to the floor; the distance is {1e3 * _rms_norm((foot - z)[:, :2]):.2f} mm RMS on this walk.",
        ),
    )
    t = truth.time_s
    columns = {"time_s": t} | {
        f"{name}_{axis_name}_m": track[:, k]
        for name, track in (("com", c), ("zmp", z), ("cart_zmp", cart), ("axis_on_floor", foot))
        for k, axis_name in enumerate("xy")
    }
    return Reproduction(
        claims=claims,
        note="Simulated walk of TALOS without sensor noise. The cart-table model deviates from the ZMP by "
        f"{1e3 * _rms_norm(cart - z[:, :2]):.1f} mm RMS (at most {1e3 * cart_distance.max():.0f} mm) because of "
        "L' and the "
        "varying height. The distance of the CoM from the central axis is "
        f"{1e3 * _rms_norm(axis.project(c) - c):.1f} mm "
        "RMS, which is due to L' alone.",
        tables={"points": columns},
        drawing=render_svg(*_draw_panels(t, c, z, cart, foot, n)),
        references=("carpentier2017thesis", "stasse2017talos"),
    )


def _printed_2_8(truth: TrueMotion) -> np.ndarray:
    """(2.8) as printed in the thesis, with L' about y and z, both added."""
    c, a, rate = truth.com_m, truth.acceleration_m_s2, truth.momentum_rate_nm
    lift = (a[:, 2] + GRAVITY_M_S2)[:, None]
    turn = np.column_stack([-rate[:, 1], rate[:, 2]])
    return np.asarray(c[:, :2] - c[:, 2:] / lift * a[:, :2] + turn / (truth.mass_kg * lift))


def _predicted_gap(wrench: Wrench, z: Points) -> Series:
    """Distance on the floor between ZMP and axis: the offset ``f x (tau n) / f^2``, horizontal as n is vertical."""
    f = wrench.force_n
    at_zmp = transport(wrench, z)
    offset = np.cross(f, at_zmp.moment_nm) / (f * f).sum(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(offset[:, :2], axis=1))


def _least_moment_ratio(wrench: Wrench, point_m: Points) -> float:
    """Moment norm 1 cm from the axis relative to that on it; minimum over all samples and eight directions."""
    on_axis = np.linalg.norm(transport(wrench, point_m).moment_nm, axis=1)
    beside = []
    for turn in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        away = 0.01 * np.array([np.cos(turn), np.sin(turn), 0.0])
        beside.append(np.linalg.norm(transport(wrench, point_m + away).moment_nm, axis=1))
    return float((np.min(beside, axis=0) / on_axis).min())


def _angle_between(u: Points, v: Points) -> Series:
    sine = np.linalg.norm(np.cross(u, v), axis=1)
    return np.asarray(np.arctan2(sine, np.abs((u * v).sum(axis=1))))


def _rms_norm(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean((error**2).sum(axis=1))))


def _draw_panels(t: Series, c: Points, z: Points, cart: np.ndarray, foot: Points, n: Points) -> list[Panel]:
    panels = [
        Panel(
            f"Relative to the CoM, {name}",
            "time (s)",
            "from the CoM (mm)",
            [
                Curve(t, 1e3 * (z[:, k] - c[:, k]), "ZMP (2.7)", 0),
                Curve(t, 1e3 * (cart[:, k] - c[:, k]), "cart-table (2.9)", 0, dashed=True),
                Curve(t, 1e3 * (foot[:, k] - c[:, k]), "axis on the floor", 2, dashed=True),
            ],
        )
        for k, name in enumerate(("along the walk", "lateral"))
    ]
    k = int(np.argmax(np.abs(cart[:, 0] - z[:, 0])))
    top = foot[k, 0] + n[k, 0] / n[k, 2] * c[k, 2]
    sagittal = [
        Curve(np.array([z[k, 0], c[k, 0]]), np.array([0.0, c[k, 2]]), "ZMP to CoM", 0),
        Curve(np.array([cart[k, 0], c[k, 0]]), np.array([0.0, c[k, 2]]), "cart-table", 0, dashed=True),
        Curve(np.array([foot[k, 0], top]), np.array([0.0, c[k, 2]]), "central axis", 2),
    ]
    return [*panels, Panel(f"Side view at {t[k]:.2f} s", "x, m", "z, m", sagittal)]
