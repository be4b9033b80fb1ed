"""Simulated markers, segment table, plates and clocks of a drawn motion.

Errors of the geometry: the table's mass fractions and centres of mass (their sum over the limbs follows the posture),
an unseen load on the trunk, soft tissue that moves with the stride and after each contact, marker noise, possibly
filtered. Errors of the plates: each contact has its own plate with an offset, a drift and coloured noise of force, and
a moment about the foot; on a belt there are two plates, and one without steps. The force is late, and the stated mass
is wrong by a little. Sizes are drawn for each person, with heavy tails, so that no stated size is the true one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.random import Generator
from scipy import signal
from scipy.interpolate import CubicSpline

from experiments.people.limbs import LIMBS
from experiments.people.movements import RATE_HZ, DrawnMotion, Movement, draw_motion, draw_person, wandering
from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.conventions import Points
from stridelab.recordings.recording import Window, WrenchTrack

FRAME_HZ: Final = 100.0
MARGIN_S: Final = 0.6
"""Motion before the first and after the last frame, so that filters and late forces have data."""
TAILS: Final = 5.0
"""Degrees of freedom of the t-distributions of constant errors."""
STATED_SD_M: Final = (0.008, 0.008, 0.020)
"""Stated error of the table: not the drawn one, which is smaller sideways."""


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """Sizes of the errors, standard deviations unless noted otherwise; 0 switches a part off.

    ``table_mass`` (relative) and ``table_lever`` (of the limb's length) are errors of each limb, ``trunk_m`` of the
    trunk forwards and sideways. ``tissue_m`` is the soft-tissue movement of a thigh; other limbs have less.
    ``load_share`` is the range of an unseen load over body mass, worn with probability ``loaded``. Plates:
    ``plate_n`` and ``plate_nm`` constant, ``drift_n_s`` per second, ``noise_n`` and ``noise_nm`` coloured.
    ``late_s`` is the range of the latency.
    """

    table_mass: float = 0.12
    table_lever: float = 0.03
    trunk_m: tuple[float, float] = (0.014, 0.004)
    tissue_m: float = 0.008
    marker_m: float = 0.0006
    loaded: float = 0.2
    load_share: tuple[float, float] = (0.03, 0.06)
    plate_n: float = 1.0
    plate_nm: float = 1.0
    drift_n_s: float = 0.1
    noise_n: float = 3.0
    noise_nm: float = 1.0
    late_s: tuple[float, float] = (0.0, 0.02)
    mass_share: float = 0.005


@dataclass(frozen=True, eq=False)
class DrawnRecording:
    """One recording of a drawn person, and the truth at its frames. ``true_latency_s`` is that of the force."""

    movement: Movement
    loaded: bool
    geometric: GeometricCom
    mass_kg: float
    com_m: Points
    force_n: Points
    true_latency_s: float
    window: Window
    _measured: CubicSpline = field(repr=False)

    def wrench_at(self, latency_s: float) -> WrenchTrack:
        """Measured total wrench at the frames, read ``latency_s`` later than its time stamps."""
        t = self.geometric.time_s
        both = self._measured(t + latency_s)
        complete = (t >= self.window.start_s - 1e-9) & (t <= self.window.end_s + 1e-9)
        windows = (Window(float(t[complete][0]), float(t[complete][-1])),)
        return WrenchTrack(t, both[:, :3], both[:, 3:], complete, windows, latency_s, clocks_compared=True)


def draw_recording(
    seed: int,
    movement: Movement,
    errors: SensorErrors | None = None,
    duration_s: float = 6.0,
    frame_hz: float = FRAME_HZ,
) -> DrawnRecording:
    """Draw a person, a motion and a recording of it.

    Half of the walks and runs are on a belt with force throughout. The others cross plates: the force is known for one
    and a half steps of a walk, and for the middle half of a run.
    """
    rng = np.random.default_rng(seed)
    errors = errors or SensorErrors()
    belt = movement in ("walk", "run") and bool(rng.random() < 0.5)
    crossing = movement in ("walk", "run") and not belt
    if crossing:
        duration_s = min(duration_s, 3.0)
    motion = draw_motion(rng, movement, draw_person(rng), duration_s + 2 * MARGIN_S, belt=belt)
    time_s = np.arange(round(duration_s * frame_hz)) / frame_hz
    frames = np.rint((time_s + MARGIN_S) * RATE_HZ).astype(int)
    loaded = bool(rng.random() < errors.loaded)
    com, force, mass = motion.com_m, motion.force_n, motion.person.mass_kg
    if loaded:
        # The load is a part of the body: the drawn path is that of both, and the limbs hang beside it.
        share = rng.uniform(*errors.load_share)
        place = rng.normal(0.0, 1.0, 3) * [0.12, 0.06, 0.08] + [-0.08, 0.0, 0.05]
        limb = {name: track - share * place for name, track in motion.limb_m.items()}
    else:
        limb = dict(motion.limb_m)
    limbs = _seen_limbs(rng, motion, limb, errors)
    geometry = np.sum([fraction * track for fraction, track in limbs.values()], axis=0)
    late = float(rng.uniform(*errors.late_s))
    window = Window(0.0, float(time_s[-1]))
    if crossing:
        middle, half = duration_s / 2, 0.25 * duration_s
        if movement == "walk":
            steps = np.diff([a for a, _, _ in motion.contacts]).mean()
            half = max(0.45, 0.75 * float(steps))
        window = Window(middle - half, middle + half)
    geometric = GeometricCom(
        time_s=time_s,
        com_m=geometry[frames],
        table="drawn",
        segments={name: SegmentTrack(fraction, track[frames]) for name, (fraction, track) in limbs.items()},
        joint_centres_m={},
        sd_m=STATED_SD_M,
        ground_m_s=np.array([motion.ground_m_s, 0.0, 0.0]),
    )
    return DrawnRecording(
        movement=movement,
        loaded=loaded,
        geometric=geometric,
        mass_kg=mass * (1 + errors.mass_share * float(rng.normal())),
        com_m=com[frames],
        force_n=force[frames],
        true_latency_s=late,
        window=window,
        _measured=_measured_wrench(rng, motion, errors, belt=belt, late_s=late),
    )


def _heavy_tailed(rng: Generator, size: float, shape: tuple[int, ...]) -> np.ndarray:
    """Student's t with the standard deviation ``size``."""
    return np.asarray(size * np.sqrt((TAILS - 2) / TAILS) * rng.standard_t(TAILS, shape))


def _seen_limbs(
    rng: Generator, motion: DrawnMotion, limb: Mapping[str, Points], errors: SensorErrors
) -> dict[str, tuple[float, Points]]:
    """Believed mass fraction and seen centre of mass of every limb."""
    tissue = _tissue_of_limbs(rng, motion, errors)
    cut_hz = rng.choice([0.0, 6.0, 10.0])
    limbs, total = {}, 0.0
    pairs: dict[str, np.ndarray] = {}
    for name, (fraction, length, _) in LIMBS.items():
        twin = name[2:] if name[1] == "_" else name
        mass, lever = pairs.setdefault(twin, _heavy_tailed(rng, 1.0, (2,)))
        believed = fraction * max(0.2, 1 + errors.table_mass * (mass + rng.normal() / 6))
        length_m = length * motion.person.height_m
        moved = limb[name] + errors.table_lever * lever * length_m * motion.along[name] + tissue[name]
        if name == "trunk":
            moved = moved + _heavy_tailed(rng, 1.0, (3,)) * [*errors.trunk_m, 0.0] * motion.person.height_m / 1.72
        noise = rng.normal(size=moved.shape) * errors.marker_m * np.sqrt(RATE_HZ / FRAME_HZ) / np.sqrt(fraction * 13)
        noise = signal.sosfiltfilt(signal.butter(2, 0.8 * FRAME_HZ / 2, fs=RATE_HZ, output="sos"), noise, axis=0)
        moved = moved + noise
        if cut_hz > 0.0:
            moved = signal.sosfiltfilt(signal.butter(2, cut_hz, fs=RATE_HZ, output="sos"), moved, axis=0, padlen=600)
        limbs[name] = (believed, moved)
        total += believed
    return {name: (believed / total, track) for name, (believed, track) in limbs.items()}


_SOFT: Final[Mapping[str, float]] = {"thigh": 1.0, "shank": 0.5, "trunk": 0.35, "pelvis": 0.5, "arm": 0.5}


def _tissue_of_limbs(rng: Generator, motion: DrawnMotion, errors: SensorErrors) -> dict[str, Points]:
    """Displacement of each limb's markers: harmonics of the stride, and a damped wobble after each contact."""
    t, moved = motion.time_s, {}
    harder = 1.0 if motion.movement in ("walk", "stand") else 1.5
    resting = 0.15 if motion.movement == "stand" else 1.0
    for name in LIMBS:
        size = errors.tissue_m * _SOFT.get(name[2:] if name[1] == "_" else name, 0.2) * rng.lognormal(0.0, 0.4)
        track = 0.3 * resting * np.column_stack([wandering(rng, t, 2.0) for _ in range(3)])
        for times in (1, 2, 3):
            phase, part = rng.uniform(0, 2 * np.pi, 3), rng.normal(0.0, 0.6 / times, 3)
            track += resting * part * np.cos(2 * np.pi * times * motion.stride[:, None] + phase)
        wobble_hz, decay = rng.uniform(5.0, 11.0), rng.uniform(12.0, 25.0)
        for start, _, side in motion.contacts:
            if motion.movement != "stand" and (side == 0 or name[1] != "_" or (name[0] == "l") == (side > 0)):
                later = np.maximum(t - start, 0.0)
                ring = harder * 0.4 * np.exp(-decay * later) * np.sin(2 * np.pi * wobble_hz * later)
                track += ring[:, None] * [0.3, 0.2, -1.0]
        moved[name] = size * track
    return moved


def _measured_wrench(
    rng: Generator, motion: DrawnMotion, errors: SensorErrors, *, belt: bool, late_s: float
) -> CubicSpline:
    """Spline through measured force and moment at the origin, over the time stamps of the frames' clock."""
    t, force = motion.time_s, motion.force_n.copy()
    moment = np.cross(motion.com_m, motion.force_n) + motion.momentum_rate_nm
    shared = {}
    for number, (start, end, side) in enumerate(motion.contacts):
        on = np.clip((t - start) / 0.02, 0, 1) * np.clip((end - t) / 0.02, 0, 1)
        if not on.any():
            continue
        plate = side if belt or motion.movement in ("stand", "hop") else number
        if plate not in shared:
            shared[plate] = (
                _heavy_tailed(rng, errors.plate_n, (3,)),
                _heavy_tailed(rng, errors.drift_n_s, (3,)),
                _heavy_tailed(rng, errors.plate_nm, (3,)),
            )
        offset, drift, offset_nm = shared[plate]
        error = on[:, None] * (offset + drift * t[:, None])
        middle = int(np.clip(round((start + end) / 2 * RATE_HZ), 0, len(t) - 1))
        foot = motion.com_m[middle] * [1.0, 1.0, 0.0]
        force += error
        moment += on[:, None] * offset_nm + np.cross(foot, error)
    loaded = motion.force_n[:, 2:] > 0.0
    noise_n = errors.noise_n * _coloured(rng, len(t)) * loaded
    noise_nm = errors.noise_nm * _coloured(rng, len(t)) * loaded
    force += noise_n
    moment += noise_nm + np.cross(motion.com_m * [1.0, 1.0, 0.0], noise_n)
    return CubicSpline(t - MARGIN_S + late_s, np.hstack([force, moment]))


def _coloured(rng: Generator, n: int) -> Points:
    """Unit noise whose power falls with frequency, with a resonance of the plate, low-passed at 45 Hz."""
    f = np.fft.rfftfreq(n, 1 / RATE_HZ)
    shape = 1 / np.sqrt(1 + (f / 8) ** 2) + 1.0 * np.exp(-(((f - 28) / 4) ** 2))
    shape *= 1 / np.sqrt(1 + (f / 45) ** 8)
    shape[0] = 0.0
    x = np.fft.irfft(shape[:, None] * np.fft.rfft(rng.normal(size=(n, 3)), axis=0), n, axis=0)
    return np.asarray(x / x.std(axis=0))
