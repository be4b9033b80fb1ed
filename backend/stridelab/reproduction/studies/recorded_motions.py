"""Two consecutive steps of a recorded walk as a problem (4.20): contacts, durations and both ends are the person's.

Phases are single, double, single, double support, from a lift-off to the second lift-off of the other foot. A sole is
the rectangle from the back of the heel to the tip of the toes, as broad as the ball, where the foot is flat; it stays
there until its lift-off. Position and velocity at both ends are those of the smoother, the angular momentum that of
the segments as point masses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotEstimable
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.smoother import Smoother
from stridelab.measures.walk_motion import UP, WalkMotion, walk_motion
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Plate, Side, WrenchTrack
from stridelab.reproduction.common.recorded_walks import RecordedWalk
from stridelab.reproduction.studies.human_proxy import human_proxies
from stridelab.robots.robot import Effector
from stridelab.walking.gait_events import find_contacts
from stridelab.walking.steps import GaitStep, find_steps

NODES_HZ: Final = 25.0
FRICTION: Final = 0.8
"""Of shoes or skin on a dry floor: the measured forces stay below 0.3."""
FLAT: Final = (0.3, 0.6)
"""Part of the time from a strike to the lift-off in which the foot is flat."""
LEVEL_M: Final = 0.05
"""Height up to which a plate belongs to the floor."""
BELOW_M, BESIDE_M = 0.02, 0.05
"""How far a plate's surface may lie above the markers of a foot on it, and the middle of the foot beside the plate."""
EFFECTOR: Final[Mapping[Side, str]] = {"left": "left_foot", "right": "right_foot"}
OTHER: Final[Mapping[Side, Side]] = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Two steps of a person at the nodes of ``problem`` (n of them, m intervals), axes ahead, left, up.

    ``force_n`` is the measured force averaged over each interval, valid where ``measured``.
    """

    person: str
    problem: CentroidalProblem
    com_m: Float[np.ndarray, "n 3"]
    force_n: Float[np.ndarray, "m 3"]
    measured: Bool[np.ndarray, "m"]

    @property
    def height_m(self) -> float:
        """Height of the centre of mass above the soles, mean of both ends."""
        return float(self.problem.com_start_m[UP] + self.problem.com_end_m[UP]) / 2.0


def recorded_motion(path: Path, seed: int = 0) -> RecordedMotion:
    """The first two consecutive whole steps of a recording, the first one on plates.

    ``seed`` draws the postures of the person's densities.

    Raises ``NotEstimable`` (``no-two-steps``) without them or where a foot or the segments are hidden, and the errors
    of ``RecordedWalk.from_file`` and of the smoother.
    """
    walk = RecordedWalk.from_file(path)
    latency = estimate_latency(walk.geometric, walk.total_wrench, walk.mass_kg)
    latency_s = latency.latency_s if latency.significant else 0.0
    wrench = walk.total_wrench(latency_s)
    estimate = Smoother(beyond_window=True).estimate(walk.geometric, wrench, walk.mass_kg)
    landmarks = identify(list(walk.recording.markers_m)).landmarks
    contacts = find_contacts(walk.recording, landmarks, latency_s=latency_s)
    steps = find_steps(walk.recording, landmarks, walk.windows, latency_s=latency_s, contacts=contacts)
    subject = walk.recording.subject
    motion = walk_motion(
        walk.recording, landmarks, estimate, walk.geometric, contacts, mass_kg=walk.mass_kg, stature_m=subject.height_m
    )
    pair = _first_pair(steps, estimate)
    if motion is None or pair is None or subject.height_m is None:
        raise NotEstimable("no-two-steps", f"{path.name} has no two consecutive steps with the first one on plates.")
    sequence, effectors = _contact_sequence(motion, pair, walk.recording.plates)
    start_s, end_s = pair[0].lift_off_s, pair[1].next_lift_off_s
    ends = [_state(motion, walk.mass_kg, at_s) for at_s in (start_s, end_s)]
    problem = CentroidalProblem(
        sequence=sequence,
        mass_kg=walk.mass_kg,
        effectors=effectors,
        proxies=human_proxies(subject.height_m, subject.sex or "male", seed),
        com_start_m=motion.interpolate_track(motion.com_m, start_s),
        com_end_m=motion.interpolate_track(motion.com_m, end_s),
        node_rate_hz=NODES_HZ,
        contact_margin_m=(0.0, 0.0),
        control=CircularCones(),
        start=ends[0],
        terminal="moving",
        end=ends[1],
    )
    nodes_s = start_s + problem.grid().time_s
    force_n, measured = _mean_forces(wrench, nodes_s, motion)
    com_m = np.array([motion.interpolate_track(motion.com_m, at_s) for at_s in nodes_s])
    return RecordedMotion(walk.person, problem, com_m, force_n, measured)


def _first_pair(steps: Sequence[GaitStep], estimate: ComEstimate) -> tuple[GaitStep, GaitStep] | None:
    """The first measured step and the step that follows it without a gap, both within the estimate."""
    for one, following in pairwise(steps):
        within = estimate.time_s[0] <= one.lift_off_s and following.next_lift_off_s <= estimate.time_s[-1]
        joined = one.side != following.side and abs(following.lift_off_s - one.next_lift_off_s) < 1e-6
        if one.measured and within and joined:
            return one, following
    return None


def _contact_sequence(
    motion: WalkMotion, pair: tuple[GaitStep, GaitStep], plates: Sequence[Plate]
) -> tuple[ContactSequence, Mapping[str, Effector]]:
    """Contacts of both steps, and the soles with the sizes of the person's feet."""
    one, two = pair
    stances = (
        (one.prior_strike_s or one.lift_off_s - (one.strike_s - one.lift_off_s), one.next_lift_off_s, OTHER[one.side]),
        (one.strike_s, two.next_lift_off_s, one.side),
        (two.strike_s, two.strike_s + (two.next_lift_off_s - one.strike_s), two.side),
    )
    soles = [_sole(motion, *stance, plates) for stance in stances]
    sizes = {side: half for (_, half), (_, _, side) in zip(soles, stances, strict=True)}
    contacts = [
        Contact(EFFECTOR[side], place, "floor", FRICTION, half_size_m=sizes[side])
        for (place, _), (_, _, side) in zip(soles, stances, strict=True)
    ]
    durations = np.diff([one.lift_off_s, one.strike_s, one.next_lift_off_s, two.strike_s, two.next_lift_off_s])
    standing = (contacts[:1], contacts[:2], contacts[1:2], contacts[1:])
    phases = tuple(
        ContactPhase(float(duration_s), {contact.effector: contact for contact in on})
        for duration_s, on in zip(durations, standing, strict=True)
    )
    sequence = ContactSequence("two recorded steps", "person", FRICTION, Terrain(()), phases)
    tools = {
        EFFECTOR[side]: Effector(EFFECTOR[side], "", "surface", Placement.identity(), contact_half_size_m=half)
        for side, half in sizes.items()
    }
    return sequence, tools


def _sole(
    motion: WalkMotion, strike_s: float, lift_off_s: float, side: Side, plates: Sequence[Plate]
) -> tuple[Placement, tuple[float, float]]:
    """Placement on the floor or a stair, and half edges, of a sole where the foot is flat and visible."""
    flat = [strike_s + share * (lift_off_s - strike_s) for share in FLAT]
    during = motion.samples(*flat)
    outline = motion.feet[side].outline_m[during]
    if not np.isfinite(outline).any(axis=0).all():
        raise NotEstimable("no-two-steps", f"The {side} foot is hidden while it is flat.")
    left_heel, right_heel, left_ball, right_ball, tip = np.nanmedian(outline, axis=0)
    heel = (left_heel + right_heel) / 2.0
    along = (tip - heel)[:2]
    length_m, breadth_m = float(np.linalg.norm(along)), float(np.linalg.norm((left_ball - right_ball)[:2]))
    c, s = along / length_m
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = (heel + tip) / 2.0
    at_m = motion.in_world(np.broadcast_to(middle, motion.com_m.shape))[during]
    middle[UP] = ground_height_m(np.median(at_m, axis=0), plates)
    return Placement(middle, rotation), (length_m / 2.0, breadth_m / 2.0)


def ground_height_m(foot_m: Vector3, plates: Sequence[Plate]) -> float:
    """Height of the highest plate of stairs below the markers of a foot; without any, that of the floor."""
    heights_m = [float(plate.corners_m[:, UP].mean()) for plate in plates if _covers(plate, foot_m)]
    stairs_m = [height_m for height_m in heights_m if abs(height_m) > LEVEL_M and height_m < foot_m[UP] + BELOW_M]
    return max(stairs_m, default=0.0)


def _covers(plate: Plate, point_m: Vector3) -> bool:
    """Whether the point lies above or below the plate's rectangle, or at most 5 cm beside it."""
    corners = plate.corners_m[:, :2]
    return bool(
        (corners.min(axis=0) - BESIDE_M <= point_m[:2]).all() and (point_m[:2] <= corners.max(axis=0) + BESIDE_M).all()
    )


def _state(motion: WalkMotion, mass_kg: float, at_s: float) -> Start:
    velocity_m_s, momentum_nms = (
        motion.interpolate_track(motion.velocity_m_s, at_s),
        mass_kg * motion.interpolate_track(motion.momentum_per_kg, at_s),
    )
    if not np.isfinite([velocity_m_s, momentum_nms]).all():
        raise NotEstimable("no-two-steps", f"A segment is hidden at {at_s:.2f} s, at the end of a step.")
    return Start(velocity_m_s, momentum_nms)


def _mean_forces(
    wrench: WrenchTrack, nodes_s: Series, motion: WalkMotion
) -> tuple[Float[np.ndarray, "m 3"], Bool[np.ndarray, "m"]]:
    """Force averaged over the intervals between nodes, and where all of it is measured."""
    force, measured = [], []
    for start_s, end_s in pairwise(nodes_s.tolist()):
        inside = (wrench.time_s >= start_s) & (wrench.time_s < end_s)
        known = bool(inside.any()) and bool(wrench.complete[inside].all())
        measured.append(known)
        force.append(wrench.force_n[inside].mean(axis=0) @ motion.frame.T if known else np.full(3, np.nan))
    return np.array(force), np.array(measured)
