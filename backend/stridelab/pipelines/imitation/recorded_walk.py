"""The walk of a person as footholds and times: what a robot needs to step as the person does.

Positions are in the frame of the walk: ahead, left. A foothold is the middle of the foot's outline (``foot_outline``),
between the back of the heel and the tip of the toes. While the whole foot rests, it follows from both ends; from a heel
that has just struck, or from a ball that is about to lift off, by the distance of that end from the middle. A swing
that is not wholly recorded lasts as long as the mean of the recorded swings.

On stairs the height of a foothold is that of the foot's lowest marker while it stands, above the lowest foothold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Mask
from stridelab.errors import NotEstimable
from stridelab.measures.walk_motion import AHEAD, OTHER_SIDE, FootMotion, WalkMotion
from stridelab.pipelines.gait_measures.recording import MeasuredRecording
from stridelab.recordings.foot_contact import find_feet, ground_of_feet_m_s, is_treadmill
from stridelab.recordings.recording import Recording, Side
from stridelab.walking.gait_events import Contact
from stridelab.walking.preconditions import RISE_M, contact_heights_m
from stridelab.walking.steps import GaitStep

LEAST_FOOTHOLDS, MOST_FOOTHOLDS = 3, 12
"""Of a longer run of footholds, the middle is taken: every plan takes seconds per step."""
REST_SPEED_SHARE: Final = 0.25
"""Largest speed of the end of a resting foot, over the walking speed."""
EVENT_SPAN_S: Final = 0.04
"""Span at a strike or before a lift-off in which one end of a foot is on the floor."""
_MARKER_MAX_M: Final = 0.1
"""Greatest height of the lowest marker of a standing foot above its plate."""
HEEL, BALL, TIP = slice(0, 2), slice(2, 4), 4


@dataclass(frozen=True)
class Foothold:
    """Place of one foot: middle of the sole (ahead, left) in metres, its yaw from the way ahead, and its height."""

    side: Side
    position_m: Float[np.ndarray, "2"]
    yaw_rad: float
    height_m: float = 0.0


@dataclass(frozen=True)
class RecordedWalk:
    """Footholds in order, and the times of the steps between them.

    ``swing_s[k]`` is the time in which the foot of ``footholds[k]`` moves there, and ``double_support_s[k]`` the time
    in which both feet stand from then on; shape (n,). ``strikes_s[k]`` is the time of the recording at which that foot
    strikes, NaN if it is not recorded. ``hip_height_m`` is the mean height of the hip joints above the
    floor during the walk, ``com_height_m`` that of the CoM.
    """

    footholds: tuple[Foothold, ...]
    swing_s: Float[np.ndarray, "n"]
    double_support_s: Float[np.ndarray, "n"]
    hip_height_m: float
    com_height_m: float
    speed_m_s: float
    strikes_s: Float[np.ndarray, "n"]

    @property
    def step_lengths_m(self) -> Float[np.ndarray, "m"]:
        """Distance ahead from each foothold to the next, shape (n - 1,)."""
        return np.diff([hold.position_m[AHEAD] for hold in self.footholds])

    @property
    def is_level(self) -> bool:
        """Whether all footholds have one height; on stairs some differ by more than 5 cm."""
        return not rises_of(self.footholds)

    @property
    def step_widths_m(self) -> Float[np.ndarray, "m"]:
        """Distance aside between consecutive footholds, positive if the left foot is to the left, shape (n - 1,)."""
        left = [hold.position_m[1] for hold in self.footholds]
        signs = [1.0 if hold.side == "left" else -1.0 for hold in self.footholds[1:]]
        return np.diff(left) * signs

    @property
    def froude_number(self) -> float:
        """``v^2 / (g l)`` with the height of the hips as l."""
        return self.speed_m_s**2 / (9.81 * self.hip_height_m)


def rises_of(footholds: Sequence[Foothold]) -> list[float]:
    """Height from each foothold to the next in metres, negative downwards; empty on level ground."""
    rises = np.diff([hold.height_m for hold in footholds])
    return rises.tolist() if rises.any() else []


def recorded_walk(measured: MeasuredRecording) -> RecordedWalk:
    """The walk of a measured recording.

    Raises ``NotEstimable``: ``too-few-footholds`` for less than three footholds in a row, ``belt-speed-unknown`` for a
    treadmill whose belt has no speed, ``hips-not-marked`` without hip joints.
    """
    _require_known_belt(measured)
    recording, landmarks = measured.prepared.trial.recording, measured.prepared.trial.match.landmarks
    heights_m = contact_heights_m(recording, find_feet(recording, landmarks), measured.contacts)
    if not np.isfinite(heights_m).all() or np.abs(np.diff(heights_m)).max(initial=0.0) <= RISE_M:
        return walk_of_motion(measured.motion, measured.contacts, measured.steps, _hip_height_m(measured))
    floors_m = [height - _marker_height_m(recording, heights_m) for height in heights_m]
    hips_m, coms_m = _heights_above(measured, floors_m)
    walk = walk_of_motion(measured.motion, measured.contacts, measured.steps, hips_m, heights_m)
    return replace(walk, com_height_m=coms_m)


def walk_of_motion(
    motion: WalkMotion,
    contacts: Sequence[Contact],
    steps: Sequence[GaitStep],
    hip_height_m: float,
    heights_m: Sequence[float] | None = None,
) -> RecordedWalk:
    """The longest run of footholds of both feet in turn, at most the middle ``MOST_FOOTHOLDS``, with their times.

    ``heights_m`` are those of the contacts on stairs; consecutive ones within ``RISE_M`` share a tread.

    Raises ``NotEstimable`` (``too-few-footholds``).
    """
    holds = [(contact, _foothold(motion, contact)) for contact in contacts]
    if heights_m is not None:
        holds = [(c, h and replace(h, height_m=z)) for (c, h), z in zip(holds, heights_m, strict=True)]
    run = _longest_alternation([(contact, hold) for contact, hold in holds if hold is not None])
    if len(run) < LEAST_FOOTHOLDS:
        raise NotEstimable(
            "too-few-footholds",
            f"An imitation needs at least {LEAST_FOOTHOLDS} footholds in a row, of both feet in turn; in "
            f"{motion.time_s[-1] - motion.time_s[0]:.2f} s there are {len(run)}.",
        )
    first = max(0, (len(run) - MOST_FOOTHOLDS) // 2)
    run = run[first : first + MOST_FOOTHOLDS]
    run = [(contact, hold) for (contact, _), hold in zip(run, _on_treads([hold for _, hold in run]), strict=True)]
    swing_s, double_support_s = _step_times([contact for contact, _ in run], steps)
    return RecordedWalk(
        tuple(hold for _, hold in run),
        swing_s,
        double_support_s,
        hip_height_m,
        motion.mean_height_m,
        motion.mean_speed_m_s,
        np.array([np.nan if contact.strike_s is None else contact.strike_s for contact, _ in run]),
    )


def _require_known_belt(measured: MeasuredRecording) -> None:
    recording, landmarks = measured.prepared.trial.recording, measured.prepared.trial.match.landmarks
    feet = find_feet(recording, landmarks)
    if is_treadmill(recording) and not ground_of_feet_m_s(feet).any():
        raise NotEstimable(
            "belt-speed-unknown",
            "This is a treadmill whose belt speed is not known, so that the length of the steps is not; state it.",
        )


def _hip_height_m(measured: MeasuredRecording) -> float:
    centres = measured.prepared.geometric.joint_centres_m
    hips = [centres[name] for name in ("l_hip", "r_hip") if name in centres]
    if not hips or not np.isfinite(hips).any():
        raise NotEstimable("hips-not-marked", "The legs' length needs the hips, and the pelvis is not marked.")
    floor_m = float(np.mean(np.atleast_2d(measured.motion.origin_m)[:, 2]))
    return float(np.nanmean([hip[:, 2] for hip in hips])) - floor_m


def _marker_height_m(recording: Recording, heights_m: Sequence[float]) -> float:
    """Median height of the lowest marker of a standing foot above the plate below it; 0 without a plate below."""
    plates_m = [plate.corners_m[:, 2].mean() for plate in recording.plates if plate.use and plate.corners_m.any()]
    above = [min((h - p for p in plates_m if 0.0 <= h - p < _MARKER_MAX_M), default=np.nan) for h in heights_m]
    return float(np.nanmedian(above)) if np.isfinite(above).any() else 0.0


def _heights_above(measured: MeasuredRecording, floors_m: Sequence[float]) -> tuple[float, float]:
    """Heights of the hip joints and of the CoM above the foot in the middle of its contact (medians over contacts)."""
    geometric, estimate = measured.prepared.geometric, measured.estimate
    hips = [geometric.joint_centres_m[name] for name in ("l_hip", "r_hip") if name in geometric.joint_centres_m]
    if not hips or not np.isfinite(hips).any():
        raise NotEstimable("hips-not-marked", "The legs' length needs the hips, and the pelvis is not marked.")
    middles_s = [0.5 * (contact.start_s + contact.end_s) for contact in measured.contacts]
    hip_m = np.nanmean([hip[:, 2] for hip in hips], axis=0)
    known = np.isfinite(hip_m)
    hips_m = np.interp(middles_s, geometric.time_s[known], hip_m[known]) - floors_m
    coms_m = np.interp(middles_s, estimate.time_s, estimate.com_m[:, 2]) - floors_m
    return float(np.median(hips_m)), float(np.median(coms_m))


def _on_treads(holds: Sequence[Foothold]) -> list[Foothold]:
    """The footholds with the mean height of their tread above the lowest one."""
    treads: list[list[Foothold]] = []
    for hold in holds:
        if treads and abs(hold.height_m - treads[-1][-1].height_m) <= RISE_M:
            treads[-1].append(hold)
        else:
            treads.append([hold])
    heights_m = [float(np.mean([hold.height_m for hold in tread])) for tread in treads]
    lowest_m = min(heights_m, default=0.0)
    return [replace(h, height_m=z - lowest_m) for tread, z in zip(treads, heights_m, strict=True) for h in tread]


def _foothold(motion: WalkMotion, contact: Contact) -> Foothold | None:
    """Place of the foot in one contact; None if no end of it is seen on the floor."""
    foot = motion.feet[contact.side]
    outline = foot.outline_m[:, :, :2]
    back, ball, tip = outline[:, HEEL].mean(axis=1), outline[:, BALL].mean(axis=1), outline[:, TIP]
    within = (motion.time_s >= contact.start_s) & (motion.time_s <= contact.end_s) & np.isfinite(outline).all((1, 2))
    if not within.any():
        return None
    limit_m_s = REST_SPEED_SHARE * motion.mean_speed_m_s
    heel_rests, ball_rests = (within & (_speed_m_s(motion, track) < limit_m_s) for track in (back, ball))
    along, length_m, from_ball_m = _shape_of(foot)
    if (flat := heel_rests & ball_rests).any():
        middle = 0.5 * (back + tip)
        used = flat
    elif (used := _span(motion, contact.end_s, -EVENT_SPAN_S) & within & ball_rests).any():
        middle = ball + along * from_ball_m
    elif (used := _span(motion, contact.start_s, EVENT_SPAN_S) & within).any():
        middle = back + along * 0.5 * length_m
    else:
        return None
    ahead = np.median(along[used], axis=0)
    return Foothold(contact.side, np.median(middle[used], axis=0), float(np.arctan2(ahead[1], ahead[0])))


def _shape_of(foot: FootMotion) -> tuple[Float[np.ndarray, "n 2"], float, float]:
    """Direction of the foot on the floor (n, 2); its length, and the distance from the ball to its middle (ahead)."""
    back, ball, tip = foot.outline_m[:, HEEL].mean(axis=1), foot.outline_m[:, BALL].mean(axis=1), foot.outline_m[:, TIP]
    along = (ball - back)[:, :2]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    length_m = float(np.nanmedian(np.linalg.norm(tip - back, axis=1)))
    return along, length_m, 0.5 * length_m - float(np.nanmedian(np.linalg.norm(ball - back, axis=1)))


def _speed_m_s(motion: WalkMotion, track: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    velocity = np.gradient(track, motion.time_s, axis=0)
    return np.asarray(np.linalg.norm(velocity, axis=1))


def _span(motion: WalkMotion, at_s: float, span_s: float) -> Mask:
    first, last = sorted((at_s, at_s + span_s))
    return np.asarray((motion.time_s >= first) & (motion.time_s <= last))


def _longest_alternation(holds: Sequence[tuple[Contact, Foothold]]) -> list[tuple[Contact, Foothold]]:
    """The longest run in which left and right alternate and every foothold is ahead of the one before."""
    best: list[tuple[Contact, Foothold]] = []
    run: list[tuple[Contact, Foothold]] = []
    for contact, hold in holds:
        follows = run and hold.side == OTHER_SIDE[run[-1][1].side]
        ahead = run and hold.position_m[AHEAD] > run[-1][1].position_m[AHEAD]
        run = [*run, (contact, hold)] if follows and ahead else [(contact, hold)]
        best = max(best, run, key=len)
    return best


def _step_times(
    contacts: Sequence[Contact], steps: Sequence[GaitStep]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Swing before and double support after each strike of ``contacts``; means where a step is not wholly recorded."""
    by_strike: Mapping[float, GaitStep] = {step.strike_s: step for step in steps}
    whole = [by_strike.get(contact.strike_s) if contact.strike_s is not None else None for contact in contacts]
    swings = np.array([np.nan if one is None else one.strike_s - one.lift_off_s for one in whole])
    supports = np.array([np.nan if one is None else one.next_lift_off_s - one.strike_s for one in whole])
    fallback = [step.strike_s - step.lift_off_s for step in steps], [s.next_lift_off_s - s.strike_s for s in steps]
    return (
        np.where(np.isfinite(swings), swings, float(np.mean(fallback[0]))),
        np.where(np.isfinite(supports), supports, float(np.mean(fallback[1]))),
    )
