r"""CoM, extrapolated CoM and margin of stability of a person, frame by frame, from labelled markers and force plates.

    x = c + v / omega_0,    omega_0 = sqrt(g / l)

with c and v the horizontal position and velocity of the CoM from the online complementary filter, v against the ground,
and l the mean height of the CoM above the floor over the last seconds (Hof, Gazendam and Sinke 2005). Margins are those
of ``measures.margin_of_stability``: ahead to the foremost point of the base of support; sideways outwards to the outer
edge of the standing foot, in double support to the nearer of both. Ahead is where the pelvis faces on average over the
last second.

A frame never ends the estimation. While the markers give no CoM it is carried on by the force or by the last velocity,
for ``COAST_S``; then hidden landmarks are substituted; where that is not possible there is no estimate until they are
back. What was missing in a frame, and how it was bridged, is part of the answer.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Corners, Points, Series, Vector3
from stridelab.estimation.complementary.online_filter import OnlineComplementaryFilter
from stridelab.estimation.complementary.transfer_functions import AUTO_HIGH_HZ, AUTO_LOW_HZ
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.online.foot_support import FootState, FootSupport, PlateReading, TotalWrench
from stridelab.estimation.online.marker_geometry import GeometrySource, MarkerGeometry, PlacedBody
from stridelab.estimation.online_estimator import LONGEST_STEP_S, OnlineSample
from stridelab.recordings.recording import Recording, Side, Subject

COAST_S: Final = 0.1
"""Longest time without geometry and force that is bridged by the last velocity: a walking body then is 3 mm off."""
COAST_WITH_FORCE_S: Final = 0.5
"""Longest time without geometry that is bridged by integrating the force."""
FACING_S: Final = 1.0
HEIGHT_S: Final = 3.0
SPEED_S: Final = 1.0
_MIN_FACING: Final = 1e-3
_SHORTEST_PENDULUM_M: Final = 0.1
_UP: Final = np.array([0.0, 0.0, 1.0])
_UNUSED_MASS_KG: Final = 70.0
"""Mass of the filter if none is stated; it has no effect without force."""


@dataclass(frozen=True)
class BalanceSetup:
    """What is known before the first frame; ``landmarks`` maps a landmark to its label.

    ``belt_m_s`` is the speed of a treadmill's belt, zero over ground. Forces are used if the subject's mass is known.
    """

    landmarks: Mapping[str, str]
    subject: Subject
    rate_hz: float
    plates_m: Sequence[Corners] = ()
    belt_m_s: float = 0.0
    static: Recording | None = None
    static_landmarks: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Bridged:
    """What was missing in a frame. ``geometry`` is where its CoM comes from: ``coasted`` is from force or velocity."""

    frames_lost: int = 0
    hidden: tuple[str, ...] = ()
    geometry: str = "measured"
    force: str | None = None
    restarted: bool = False


@dataclass(frozen=True)
class BalanceSample:
    """Estimate at one frame; ``com`` is None without an estimate, ``reason`` then says why.

    Margins are in metres, positive inside the base of support; None without a base, ``margin_reason`` then says why.
    ``base_m`` are the corners of the base on the floor, ``contact`` is None for a foot that is not visible, and
    ``ahead`` is the horizontal direction in which the pelvis faces.
    """

    time_s: float
    com: OnlineSample | None = None
    reason: str | None = None
    xcom_m: Vector3 | None = None
    margin_ap_m: float | None = None
    margin_ml_m: float | None = None
    margin_reason: str | None = None
    contact: Mapping[Side, bool | None] = field(default_factory=lambda: {"left": None, "right": None})
    base_m: Points = field(default_factory=lambda: np.zeros((0, 3)))
    joint_centres_m: Mapping[str, Vector3] = field(default_factory=dict)
    ahead: Vector3 | None = None
    height_m: float | None = None
    speed_m_s: float | None = None
    bridged: Bridged = field(default_factory=Bridged)


class OnlineBalance:
    """Estimator of one stream of frames in the world frame (z up). Raises ``InvalidInput`` (``mass-out-of-range``)."""

    def __init__(self, setup: BalanceSetup) -> None:
        self._setup = setup
        self._geometry = MarkerGeometry(setup.landmarks, setup.subject, setup.static, setup.static_landmarks)
        self._support = FootSupport(setup.landmarks, setup.plates_m)
        self._filter = self._new_filter((0.01, 0.01, 0.02))
        self._last_s: float | None = None
        self._measured_s: float | None = None
        self._facing, self._height = _RunningMean(FACING_S), _RunningMean(HEIGHT_S)
        self._velocity, self._floor = _RunningMean(SPEED_S), _RunningMean(SPEED_S)
        plates = [corners[:, 2].mean() for corners in setup.plates_m]
        self._floor_m: float | None = float(np.median(plates)) if plates else None
        self._has_plates = bool(plates)

    def _new_filter(self, sd_m: tuple[float, float, float]) -> OnlineComplementaryFilter:
        self._table_sd_m, self._begun, self._forced = sd_m, False, False
        return OnlineComplementaryFilter(
            low_hz=AUTO_LOW_HZ,
            high_hz=AUTO_HIGH_HZ,
            mass_kg=_UNUSED_MASS_KG if self._setup.subject.mass_kg is None else self._setup.subject.mass_kg,
            table_sd_m=sd_m,
            priors=ErrorPriors(),
        )

    def step(self, time_s: float, points_m: Points, readings: Sequence[PlateReading | None] = ()) -> BalanceSample:
        """Estimate at a frame; ``points_m`` has one point per landmark (NaN: hidden), ``readings`` one per plate."""
        since_s = math.inf if self._last_s is None else time_s - self._last_s
        if since_s <= 0.0:
            return BalanceSample(time_s, reason="frame-late", margin_reason="frame-late")
        lost = 0 if self._last_s is None else max(round(since_s * self._setup.rate_hz) - 1, 0)
        restarted = self._last_s is not None and since_s > LONGEST_STEP_S
        if restarted:
            self._filter, self._measured_s = self._new_filter(self._table_sd_m), None
        self._last_s = time_s
        blind_s = math.inf if self._measured_s is None else time_s - self._measured_s
        is_lost = blind_s > (COAST_WITH_FORCE_S if self._forced else COAST_S)
        body = self._geometry.place(time_s, points_m, may_substitute=is_lost)
        ground = self._ground_m_s()
        self._follow_body(body, since_s)
        walking = 0.0 if self._velocity.mean is None else float(np.linalg.norm((self._velocity.mean - ground)[:2]))
        self._support.update_feet(time_s, self._geometry.window, walking, ground, readings)
        wrench = self._usable_wrench(readings)
        sample, reason = self._estimate(time_s, body, wrench.reading, is_lost)
        geometry: GeometrySource | str = "coasted" if body.com_m is None and sample is not None else body.source
        bridged = Bridged(lost, body.hidden, geometry, wrench.reason, restarted)
        answer = BalanceSample(time_s, sample, reason, joint_centres_m=body.joint_centres_m, bridged=bridged)
        answer = replace(answer, contact={foot.side: foot.contact for foot in self._support.feet.values()})
        return self._with_margins(answer, since_s)

    def _usable_wrench(self, readings: Sequence[PlateReading | None]) -> TotalWrench:
        wrench = self._support.total_wrench(readings)
        if wrench.reading is not None and self._setup.subject.mass_kg is None:
            return TotalWrench(None, "mass-not-stated")
        return wrench

    def _estimate(
        self, time_s: float, body: PlacedBody, reading: PlateReading | None, is_lost: bool
    ) -> tuple[OnlineSample | None, str | None]:
        """One step of the filter; no estimate where the geometry has been missing for too long."""
        if body.source == "measured":
            self._measured_s = time_s
        if body.com_m is not None and not self._begun:
            self._filter = self._new_filter(body.sd_m)
            self._begun = True
        self._forced = reading is not None
        if not self._begun:
            return None, body.reason
        force, moment = (None, None) if reading is None else reading
        sample = self._filter.step(time_s, body.com_m, force, moment)
        if body.com_m is None and is_lost:
            return None, body.reason
        added = np.maximum(np.square(body.sd_m) - np.square(self._table_sd_m), 0.0)
        return sample._replace(sd_m=np.sqrt(np.square(sample.sd_m) + np.nan_to_num(added))), None

    def _follow_body(self, body: PlacedBody, since_s: float) -> None:
        """Direction in which the pelvis faces, over the last second."""
        hips = body.joint_centres_m
        if "l_hip" in hips and "r_hip" in hips:
            ahead = np.cross(_UP, hips["r_hip"] - hips["l_hip"])
            self._facing.add(ahead / max(float(np.linalg.norm(ahead)), 1e-9), since_s)

    def _ground_m_s(self) -> Vector3:
        ahead = self._ahead()
        return np.zeros(3) if ahead is None else -self._setup.belt_m_s * ahead

    def _ahead(self) -> Vector3 | None:
        facing = self._facing.mean
        if facing is None or not np.linalg.norm(facing) > _MIN_FACING:
            return None
        return np.asarray(facing / np.linalg.norm(facing))

    def _with_margins(self, answer: BalanceSample, since_s: float) -> BalanceSample:
        """Add extrapolated CoM, base and margins."""
        standing = [foot for foot in self._support.feet.values() if foot.contact and foot.outline_m is not None]
        self._follow_floor(standing, since_s)
        base = (
            np.concatenate([_floor_points(foot, self._floor_m) for foot in standing]) if standing else np.zeros((0, 3))
        )
        ahead = self._ahead()
        answer = replace(answer, base_m=_convex_outline(base), ahead=ahead)
        if answer.com is None or ahead is None or self._floor_m is None:
            return replace(answer, margin_reason=answer.reason or "feet-hidden")
        velocity = answer.com.velocity_m_s - self._ground_m_s()
        self._velocity.add(answer.com.velocity_m_s, since_s)
        height = float(answer.com.com_m[2]) - self._floor_m
        pendulum_m = float(self._height.add(np.array([height]), since_s)[0])
        omega = math.sqrt(GRAVITY_M_S2 / max(pendulum_m, _SHORTEST_PENDULUM_M))
        xcom = (answer.com.com_m + velocity / omega) * [1.0, 1.0, 0.0] + [0.0, 0.0, self._floor_m]
        speed = float(np.linalg.norm(velocity[:2]))
        answer = replace(answer, xcom_m=xcom, height_m=height, speed_m_s=speed)
        if not standing:
            is_hidden = not answer.contact or all(contact is None for contact in answer.contact.values())
            return replace(answer, margin_reason="feet-hidden" if is_hidden else "no-contact")
        left = np.cross(_UP, ahead)
        sideways = [
            (1.0 if foot.side == "left" else -1.0) * (_edge(foot, left) - float(xcom @ left)) for foot in standing
        ]
        return replace(answer, margin_ap_m=float((base @ ahead).max() - xcom @ ahead), margin_ml_m=min(sideways))

    def _follow_floor(self, standing: Sequence[FootState], since_s: float) -> None:
        """Height of the floor: of the plates, else of the lowest markers of the standing feet."""
        if self._has_plates or not standing:
            return
        lowest = min(float(foot.outline_m[:, 2].min()) for foot in standing if foot.outline_m is not None)
        self._floor_m = float(self._floor.add(np.array([lowest]), since_s)[0])


def _edge(foot: FootState, left: Vector3) -> float:
    """Outermost coordinate of a foot's outline along ``left``."""
    assert foot.outline_m is not None
    along = foot.outline_m @ left
    return float(along.max() if foot.side == "left" else along.min())


class _RunningMean:
    """Mean of a track over at most the last ``memory_s``."""

    def __init__(self, memory_s: float) -> None:
        self._memory_s, self._age_s = memory_s, 0.0
        self.mean: Series | None = None

    def add(self, value: Series, since_s: float) -> Series:
        """The mean with a ``value`` that comes ``since_s`` after the previous one."""
        if self.mean is None:
            self.mean, self._age_s = value, 0.0
            return value
        step_s = min(since_s, self._memory_s)
        self._age_s = min(self._age_s + step_s, self._memory_s)
        share = min(step_s / self._age_s, 0.5) if self._age_s > 0.0 else 1.0
        self.mean = self.mean + share * (value - self.mean)
        return self.mean


def _floor_points(foot: FootState, floor_m: float | None) -> Points:
    assert foot.outline_m is not None
    return np.column_stack([foot.outline_m[:, :2], np.full(len(foot.outline_m), floor_m or 0.0)])


def _convex_outline(points: Points) -> Float[np.ndarray, "corners 3"]:
    """Corners of the convex hull seen from above, anticlockwise (Andrew 1979)."""
    ordered = sorted(points.tolist())
    corners: list[list[float]] = []
    for path in (ordered, ordered[::-1]):
        start = len(corners)
        for point in path:
            while len(corners) >= start + 2 and _turn(corners[-2], corners[-1], point) <= 0.0:
                corners.pop()
            corners.append(point)
        if corners:
            corners.pop()
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _turn(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
