"""Exact motion of drawn people who walk, run, hop and stand: centre of mass, contact force, angular momentum, limbs.

The centre of mass is drawn first. Walking and standing give its path, a few harmonics of a phase that wanders plus the
bumps of the heel strikes; running and hopping give the *force*, nothing but gravity between contacts, integrated twice.
The limbs are hung on the path so that their mean is it. Angular momentum is that of the limbs as rods. In flight it
must not change: there it is held, and the load of each contact brings it to that of the next flight; the rotation of
the trunk that this takes is not drawn in the limbs.

No stride is like the one before: phase, amplitudes, speed and posture wander, so nothing is periodic.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.random import Generator
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import make_interp_spline

from experiments.people.limbs import GYRATION, LIMBS, Angles, Posture, limb_posture, stride_curve
from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.dynamics.wrench import contact_force

Movement = Literal["walk", "run", "hop", "stand"]
MOVEMENTS: Final[tuple[Movement, ...]] = get_args(Movement)
RATE_HZ: Final = 500.0
"""Sampling of the exact motion."""
LEG_SHARE: Final = 0.55
"""Height of the centre of mass over stature."""


@dataclass(frozen=True)
class Person:
    """Body of a drawn person; ``child`` changes the proportions of mass to stature only."""

    height_m: float
    mass_kg: float
    child: bool


@dataclass(frozen=True)
class DrawnMotion:
    """Exact motion at ``RATE_HZ``: centre of mass, contact force, momentum about the centre of mass, and its rate.

    ``limb_m`` are the centres of mass of the limbs, ``along`` their directions. ``contacts`` are the times
    (start, end, +1 left or -1 right foot, 0 both) at which feet are on the ground. ``ground_m_s`` is the forward
    velocity of the ground, that of a belt.
    """

    movement: Movement
    person: Person
    time_s: Series
    com_m: Points
    force_n: Points
    momentum_nms: Points
    momentum_rate_nm: Points
    limb_m: Mapping[str, Points]
    along: Mapping[str, Points]
    stride: Series
    contacts: tuple[tuple[float, float, int], ...]
    ground_m_s: float


def draw_person(rng: Generator) -> Person:
    """Adults, and one child in five."""
    child = bool(rng.random() < 0.2)
    height_m = float(rng.uniform(1.15, 1.5) if child else rng.normal(1.72, 0.09))
    index = float(np.clip(rng.normal(16.5 if child else 23.0, 1.5 if child else 2.5), 13.0, 32.0))
    return Person(height_m, index * height_m**2, child)


def draw_motion(rng: Generator, movement: Movement, person: Person, duration_s: float, *, belt: bool) -> DrawnMotion:
    """Exact motion; with ``belt`` the person stays in place on a treadmill."""
    t = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
    leg_m = LEG_SHARE * person.height_m
    if movement == "stand":
        path, force, stride, contacts, speed = _standing(rng, person, t)
    elif movement == "walk":
        path, force, stride, contacts, speed = _walking(rng, person, t)
    else:
        path, force, stride, contacts, speed = _bouncing(rng, person, t, runs=movement == "run")
    if belt:
        path[:, 0] -= speed * t
    path[:, 2] += leg_m - path[:, 2].mean()
    posture = limb_posture(_angles(rng, movement, stride, t), person.height_m)
    mean = sum(LIMBS[name][0] * centre for name, centre in posture.centre_m.items())
    limb = {name: centre - mean for name, centre in posture.centre_m.items()}
    momentum = _momentum_of_limbs(limb, posture, person.mass_kg, t)
    if movement in ("run", "hop"):
        momentum = _unchanged_in_flight(momentum, t, contacts)
    rate = np.asarray(make_interp_spline(t, momentum, k=3)(t, 1))
    if movement in ("run", "hop"):
        rate[force[:, 2] <= 0.0] = 0.0
    return DrawnMotion(
        movement=movement,
        person=person,
        time_s=t,
        com_m=path,
        force_n=force,
        momentum_nms=momentum,
        momentum_rate_nm=rate,
        limb_m={name: path + centre for name, centre in limb.items()},
        along=posture.along,
        stride=stride,
        contacts=contacts,
        ground_m_s=-speed if belt else 0.0,
    )


def wandering(rng: Generator, t: Series, highest_hz: float) -> Series:
    """Smooth Gaussian noise of unit variance below ``highest_hz``."""
    duration = float(t[-1] - t[0]) + 4.0 / highest_hz
    f = np.arange(1, max(3, int(highest_hz * duration) + 1)) / duration
    amplitude = rng.normal(size=(2, len(f))) / np.sqrt(len(f))
    angle = 2 * np.pi * np.outer(t, f)
    return np.asarray(np.cos(angle) @ amplitude[0] + np.sin(angle) @ amplitude[1])


Drawn = tuple[Points, Points, Series, tuple[tuple[float, float, int], ...], float]


def _force_of_path(path: Points, t: Series, mass_kg: float) -> Points:
    return contact_force(np.asarray(make_interp_spline(t, path, k=5)(t, 2)), mass_kg)


def _standing(rng: Generator, person: Person, t: Series) -> Drawn:
    path = np.column_stack(
        [sd * wandering(rng, t, 0.6) + 0.1 * sd * wandering(rng, t, 2.5) for sd in rng.uniform(0.5, 1.5, 3) * _SWAY_M]
    )
    contacts = ((float(t[0]), float(t[-1]), 0),)
    return path, _force_of_path(path, t, person.mass_kg), 0.0 * t, contacts, 0.0


_SWAY_M: Final = np.array([0.005, 0.003, 0.0005])


def _walking(rng: Generator, person: Person, t: Series) -> Drawn:
    leg_m = LEG_SHARE * person.height_m
    froude = rng.uniform(0.25, 0.52)
    speed = float(froude * np.sqrt(GRAVITY_M_S2 * leg_m))
    step_hz = float(0.56 * (froude / 0.42) ** 0.5 * np.sqrt(GRAVITY_M_S2 / leg_m) * rng.normal(1.0, 0.05))
    pace = step_hz / 2 * (1 + 0.025 * wandering(rng, t, 0.6))
    stride = rng.random() + np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2) / RATE_HZ])
    w = 2 * np.pi * stride

    def swing(size_m: float, times: int, phase: float) -> Series:
        return size_m * (1 + 0.12 * wandering(rng, t, 0.8)) * np.cos(times * w + phase)

    size = leg_m * (froude / 0.42)
    step_m = speed / step_hz
    x = speed * t + 0.02 * wandering(rng, t, 0.25) + swing(0.012 * size, 2, rng.normal(1.6, 0.2))
    x += swing(0.0015 * size, 1, rng.uniform(0, 6.3)) + swing(0.0012 * size, 4, rng.uniform(0, 6.3))
    y = 0.012 * wandering(rng, t, 0.2) + swing(0.022 * rng.uniform(0.7, 1.4) / step_hz * 1.8, 1, np.pi / 2)
    y += swing(0.0012, 3, rng.normal(1.5, 0.5))
    z = swing(0.036 * step_m**2 / leg_m * rng.uniform(0.8, 1.1), 2, np.pi + rng.normal(0.0, 0.15))
    z += swing(0.0016, 4, rng.normal(0.5, 0.5)) + swing(0.001, 1, rng.uniform(0, 6.3))
    first = int(np.ceil(2 * stride[0]))
    strikes = np.interp(np.arange(first, 2 * stride[-1]) / 2, stride, t)
    for k, at in enumerate(strikes):
        bump = np.exp(-(((t - at - 0.02) / 0.014) ** 2) / 2) * rng.lognormal(0.0, 0.3)
        x, y, z = x + 6e-5 * bump, y + 4e-5 * (-1) ** k * bump, z - 2.5e-4 * bump
    path = np.column_stack([x, y, z])
    before = [(strikes[0] - n / step_hz, first - n) for n in (2, 1)]
    contacts = tuple(
        (float(at), float(at + 2 * rng.normal(0.62, 0.01) / step_hz), 1 if number % 2 else -1)
        for at, number in (*before, *((at, first + k) for k, at in enumerate(strikes)))
    )
    return path, _force_of_path(path, t, person.mass_kg), stride, contacts, speed


def _bouncing(rng: Generator, person: Person, t: Series, *, runs: bool) -> Drawn:
    """Contacts with a force like a half wave, and flights between them in which the force is zero."""
    scale = np.sqrt(LEG_SHARE * person.height_m / 0.95)
    contact_s = (rng.uniform(0.20, 0.30) if runs else rng.uniform(0.30, 0.55)) * scale
    flight_s = (rng.uniform(0.07, 0.15) if runs else rng.uniform(0.25, 0.42)) * scale
    speed = float(rng.uniform(2.2, 4.5) * scale) if runs else 0.0
    power, sharp = rng.uniform(0.9, 1.3), 2.0 * runs
    m, g, force = person.mass_kg, GRAVITY_M_S2, np.zeros((len(t), 3))

    def wave(u: Series) -> Series:
        """Half wave of the vertical force; running has the bump of the impact in it."""
        impact = sharp * u * (1 - u) * np.exp(-(((u - 0.14) / 0.06) ** 2) / 2)
        return np.asarray(np.sin(np.pi * u) ** power * (1 + impact))

    fine = np.linspace(0.0, 1.0, 801)
    area = np.trapezoid(wave(fine), fine)
    start, side, before = float(-rng.random() * contact_s), 1 if rng.random() < 0.5 else -1, flight_s
    drift_m_s, contacts, beats = np.zeros(2), [], [(start, 0.0)]
    while start < t[-1]:
        lasts, after = contact_s * rng.normal(1.0, 0.02), flight_s * rng.normal(1.0, 0.03)
        on = (t > start) & (t < start + lasts)
        u = (t[on] - start) / lasts
        # The impulse carries the weight over the contact and half of both flights.
        force[on, 2] = m * g * (lasts + (before + after) / 2) / (lasts * area) * wave(u)
        smooth, back = np.sin(np.pi * u) ** 2, 2 * m * drift_m_s / lasts
        brake = 0.09 * m * g * speed * rng.normal(1.0, 0.06)
        force[on, 0] = -brake * np.sin(2 * np.pi * u) * np.sin(np.pi * u) - back[0] * smooth
        force[on, 1] = (side * 0.05 * m * g * runs * rng.normal(1.0, 0.15) - back[1]) * smooth
        drift_m_s = rng.normal(0.0, 0.02, 2) * [1.0, 0.6] + 0.5 * drift_m_s
        contacts.append((start, float(start + lasts), side if runs else 0))
        start, before, side = float(start + lasts + after), after, -side
        beats.append((start, beats[-1][1] + 0.5))
    stride = np.interp(t, *np.transpose(beats))
    v = cumulative_trapezoid(force / m - [0.0, 0.0, g], dx=1 / RATE_HZ, axis=0, initial=0.0)
    path = cumulative_trapezoid(v, dx=1 / RATE_HZ, axis=0, initial=0.0)
    landings = [round(a * RATE_HZ) for a, _, _ in contacts if 0.0 <= a <= t[-1]]
    path -= np.outer(t, (path[landings[-1]] - path[landings[0]]) / (t[landings[-1]] - t[landings[0]]))
    path[:, 0] += speed * t
    return path, force, stride, tuple(contacts), speed


def _angles(rng: Generator, movement: Movement, stride: Series, t: Series) -> Angles:
    w = 2 * np.pi * stride
    lean = rng.normal(0.03, 0.04) + 0.02 * wandering(rng, t, 0.4)
    if movement == "stand":
        calm = [0.01 * wandering(rng, t, 0.8) for _ in range(4)]
        flex = rng.uniform(0.0, 0.12)
        pair = (flex / 2 + calm[0], flex / 2 + calm[1])
        none = 0.0 * t
        return Angles(
            lean,
            0.01 * calm[2],
            none,
            pair,
            (flex + none, flex + none),
            (none, none),
            (calm[3], -calm[3]),
            (0.2 + none, 0.25 + none),
        )
    gait = "walk" if movement == "walk" else "run"
    size = rng.uniform(0.65, 0.95) * (1 + 0.06 * wandering(rng, t, 0.6))
    roll = rng.uniform(0.01, 0.05) * np.sin(w + rng.normal(0.0, 0.3)) + 0.01 * wandering(rng, t, 0.4)
    lean = lean + rng.uniform(0.01, 0.03) * np.cos(2 * w + rng.uniform(0, 6.3))
    turn = rng.uniform(0.03, 0.12) * np.sin(w + rng.normal(0.0, 0.4))
    elbow = (0.4 if gait == "walk" else 1.3) * rng.uniform(0.6, 1.3)
    swing = rng.uniform(0.15, 0.45) * size
    if movement == "hop":
        bend = np.sin(w) ** 2 * rng.uniform(0.3, 0.6)
        both = (bend, bend)
        arms = 0.3 * swing * np.cos(2 * w)
        return Angles(
            lean + 0.3 * bend,
            0.2 * roll,
            0.0 * turn,
            both,
            (1.8 * bend, 1.8 * bend),
            (0.5 * bend, 0.5 * bend),
            (arms, arms),
            (elbow + 0.0 * t, elbow + 0.0 * t),
        )
    sides = (stride, stride + 0.5)
    return Angles(
        lean,
        roll,
        turn,
        _pair(size * stride_curve(f"{gait} hip", s) for s in sides),
        _pair(size * stride_curve(f"{gait} knee", s) for s in sides),
        _pair(stride_curve(f"{gait} ankle", s) for s in sides),
        _pair(-swing * np.cos(2 * np.pi * s) for s in sides),
        _pair(elbow + 0.2 * np.cos(2 * np.pi * s + 2.6) for s in sides),
    )


def _pair(both: Iterable[Series]) -> tuple[Series, Series]:
    left, right = both
    return left, right


def _momentum_of_limbs(limb: Mapping[str, Points], posture: Posture, mass_kg: float, t: Series) -> Points:
    total = np.zeros((len(t), 3))
    for name, centre in limb.items():
        rates = make_interp_spline(t, np.hstack([centre, posture.along[name]]), k=5)(t, 1)
        spin = (GYRATION * posture.length_m[name]) ** 2 * np.cross(posture.along[name], rates[:, 3:])
        total += LIMBS[name][0] * mass_kg * (np.cross(centre, rates[:, :3]) + spin)
    return total


def _unchanged_in_flight(momentum: Points, t: Series, contacts: tuple[tuple[float, float, int], ...]) -> Points:
    """Momentum that is constant in every flight and follows that of the limbs in the contacts, without a jump."""
    level = [0.5 * momentum[min(len(t) - 1, max(0, round(a * RATE_HZ)))] for a, _, _ in contacts]
    level.append(level[-1])
    out = np.empty_like(momentum)
    out[:] = level[0]
    for k, (start, end, _) in enumerate(contacts):
        tau = np.clip((t - start) / (end - start), 0.0, 1.0)[:, None]
        blend = tau - np.sin(2 * np.pi * tau) / (2 * np.pi)
        on = (t >= start) & (t < (contacts[k + 1][0] if k + 1 < len(contacts) else t[-1] + 1))
        line = (1 - blend) * level[k] + blend * level[k + 1]
        out[on] = (line + np.sin(np.pi * tau) ** 2 * (momentum - line) * 0.7)[on]
    return out
