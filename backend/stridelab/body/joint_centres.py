"""Joint centres of the whole body from skin landmarks.

Hips and lumbar joint follow from regressions (Dumas and Wojtusch 2018); knees, ankles, elbows and wrists lie midway
between their landmarks. With C7 and the jugular notch, cervical joint and shoulders lie in the median plane of the
thorax at regressed angles and distances (Dumas and Wojtusch 2018); otherwise they are placed by mean proportions of 11
adults.

Joint centres with the orientation of the adjacent segments, and the centre of a hinge joint.

The centre of a hinge joint (knee, ankle, elbow) follows from its outer and inner landmark, or the outer one alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, radians, sin
from typing import Final

import numpy as np

from stridelab.body.segment_tables import Anthropometry, SagittalOffset
from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, NotEstimable
from stridelab.recordings.orientation import cross, dot, median_distance_m, median_or_nan, perpendicular_unit, unit

Tracks = Mapping[str, Points]
"""Points by name, all of one trial."""

OUTWARD_SIGN: Final = {"l": -1.0, "r": 1.0}
"""Outwards on this side is ``SIGN`` times rightwards."""
_OPPOSED: Final = -0.5
"""Median cosine below which two directions that should agree count as opposed."""


@dataclass(frozen=True)
class Joints:
    """Joint centres (``l_hip``, ``lumbar``, ...) and, per segment, a vector that points roughly to its right.

    ``substitutes`` holds the codes of the substitutes in use.
    """

    centres: Tracks
    rightward: Tracks
    substitutes: frozenset[str] = frozenset()

    def __or__(self, other: "Joints") -> "Joints":
        return Joints(
            {**self.centres, **other.centres},
            {**self.rightward, **other.rightward},
            self.substitutes | other.substitutes,
        )


def has_landmarks(p: Tracks, *names: str) -> bool:
    """Whether all of these landmarks are present."""
    return set(names) <= p.keys()


_SHANKS: Final = (
    ("knee_lateral", "ankle_lateral", 1.0),
    ("knee_centre", "ankle_centre", 1.0),
    ("knee_lateral", "ankle_centre", 1.0),
    ("knee_lateral", "heel", 0.874),
)
"""Landmark pairs that measure the shank, with its length per distance (0.874, sd 0.008 in ten adults)."""


def hinge_joint(
    p: Tracks, name: str, proximal: Points, Z: Points, body: Anthropometry, widths_m: Mapping[str, float]
) -> Joints | None:
    """Joint ``name`` (``l_knee``, ...), or None if neither its outer landmark nor its centre is marked.

    If both landmarks are marked, the centre is midway between them. With the outer one o alone, the centre c lies half
    the joint width w/2 inwards, perpendicular to the segment above with upper end h (as in the conventional gait
    model):

        c = o + w/2 (cos a i + sin a u),   u = (h - o) / |h - o|,   sin a = w / (2 |h - o|)

    with i the part of ``Z`` (rightwards, with the sign of the side) perpendicular to u. ``w`` is the measured width,
    else the mean proportion of the shank.
    """
    s, joint = name.split("_")
    outer, inner, centre = (p.get(f"{name}_{kind}") for kind in ("lateral", "medial", "centre"))
    if outer is not None and inner is not None:
        middle = (outer + inner) / 2 if centre is None else centre
        return Joints({name: middle}, {name: OUTWARD_SIGN[s] * (outer - inner)})
    if centre is not None:
        return Joints({name: centre}, {name: Z})
    if outer is None:
        return None
    half = widths_m.get(name, body.proportions[joint] * shank_length_m(p)) / 2
    u = unit(proximal - outer)
    i = -OUTWARD_SIGN[s] * perpendicular_unit(Z, u)
    sin_a = min(half / median_distance_m(proximal, outer), 1.0)
    cos_a = (1.0 - sin_a**2) ** 0.5
    inwards = cos_a * i + sin_a * u
    return Joints(
        {name: outer + half * inwards}, {name: -OUTWARD_SIGN[s] * inwards}, frozenset({f"{joint}-medial-missing"})
    )


def shank_length_m(p: Tracks) -> float:
    """Length of the shank between outer markers, the unit of the proportions; NaN without suitable landmarks.

    Without ankles, the distance from knee to heel marker is used, which changes little with the ankle's angle.
    """
    for upper, lower, share in _SHANKS:
        sides = [s for s in "lr" if has_landmarks(p, f"{s}_{upper}", f"{s}_{lower}")]
        if sides:
            return share * sum(median_distance_m(p[f"{s}_{upper}"], p[f"{s}_{lower}"]) for s in sides) / len(sides)
    return float("nan")


def joint_centres(p: Tracks, body: Anthropometry, widths_m: Mapping[str, float]) -> Joints:
    """Centres of all joints from the landmark tracks ``p`` (world frame, z up).

    ``widths_m`` holds measured joint widths (``l_knee``, ...), marker centre to marker centre. A centre given in the
    file (landmark ``l_hip_centre``, ...) is used unchanged. Raises ``NotEstimable`` without pelvis or knees, and
    (``sides-swapped``) if markers of the right side lie on the left.
    """
    joints = pelvis_joints(p, body)
    for s in "lr":
        joints |= leg_joints(p, s, joints, body, widths_m)
    _require_sides(p, joints.centres)
    joints |= trunk_joints(p, joints, body)
    for s in "lr":
        joints |= arm_joints(p, s, joints, body, widths_m)
    return joints | head_joints(p, joints, body)


_HIDDEN = "This landmark is not marked, or hardly ever visible."


def pelvis_axes(p: Tracks) -> tuple[Points, Points, Points]:
    """ISB pelvis axes: Z from left to right ASIS, Y normal to the plane of ASIS and PSIS, X forwards (Wu 2002)."""
    mid_asis = (p["l_asis"] + p["r_asis"]) / 2
    mid_psis = (p["l_psis"] + p["r_psis"]) / 2 if has_landmarks(p, "l_psis", "r_psis") else p["sacrum"]
    Z = unit(p["r_asis"] - p["l_asis"])
    Y = unit(cross(Z, mid_asis - mid_psis))
    return cross(Y, Z), Y, Z


def with_pelvis(p: Tracks, body: Anthropometry) -> tuple[dict[str, Points], frozenset[str]]:
    """``p`` with iliac spines and sacrum placed from the hip centres if the pelvis is not marked, and the code of that.

    The pelvis regression is inverted, with Z from the left to the right hip and Y towards the shoulders, else upwards.
    """
    spines = has_landmarks(p, "l_asis", "r_asis")
    marked = spines and (has_landmarks(p, "sacrum") or has_landmarks(p, "l_psis", "r_psis"))
    if marked or not has_landmarks(p, "l_hip_centre", "r_hip_centre"):
        return dict(p), frozenset()
    left, right = p["l_hip_centre"], p["r_hip_centre"]
    middle, Z = (left + right) / 2, unit(right - left)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), middle.shape)
    if has_landmarks(p, "l_acromion", "r_acromion"):
        up = (p["l_acromion"] + p["r_acromion"]) / 2 - middle
    Y = perpendicular_unit(up, Z)
    X = cross(Y, Z)
    width = median_distance_m(left, right) / (2.0 * body.hip[2])
    mid_asis = middle - width * (body.hip[0] * X + body.hip[1] * Y)
    q = {name: track for name, track in p.items() if name not in ("l_psis", "r_psis")}
    q |= {"l_asis": mid_asis - width / 2 * Z, "r_asis": mid_asis + width / 2 * Z, "sacrum": mid_asis - width * X}
    return q, frozenset({"pelvis-simplified"})


def _require_sides(p: Tracks, centres: Tracks) -> None:
    """Refuse a body whose right markers lie on the left: swapped labels, or a file with mirrored axes.

    Seen from the knees, the pelvis axis Y = Z x X points away; if Z runs from right to left, it points towards them.
    Knees and shoulders follow Z, except for a trunk or a leg turned by more than 120 degrees over half of the trial.
    """
    _, Y, Z = pelvis_axes(p)
    knees = (centres["l_knee"] + centres["r_knee"]) / 2
    agreement = {"asis": dot(Y, unit((p["l_asis"] + p["r_asis"]) / 2 - knees))}
    agreement["knee"] = dot(Z, unit(centres["r_knee"] - centres["l_knee"]))
    if has_landmarks(p, "l_acromion", "r_acromion"):
        agreement["acromion"] = dot(Z, unit(p["r_acromion"] - p["l_acromion"]))
    opposed = [name for name, cosine in agreement.items() if median_or_nan(cosine) < _OPPOSED]
    if opposed:
        raise NotEstimable(
            "sides-swapped",
            "Markers labelled right lie on the left: labels are swapped, or the axes of the file are mirrored.",
            [Fault(f"{s}_{name}", "On the other side of the body.") for name in opposed for s in "lr"],
        )


def pelvis_joints(p: Tracks, body: Anthropometry) -> Joints:
    """Lumbar joint and hips: c = mid-ASIS + w (k_x X + k_y Y + k_z Z), w the distance between the ASIS.

    Raises ``NotEstimable`` (``pelvis-markers-missing``) without both ASIS and either both PSIS or a sacrum marker.
    """
    lacking = [name for name in ("l_asis", "r_asis") if name not in p]
    if not (has_landmarks(p, "l_psis", "r_psis") or has_landmarks(p, "sacrum")):
        lacking.append("l_psis")
    if lacking:
        raise NotEstimable(
            "pelvis-markers-missing",
            "The pelvis cannot be located: mark ASIS and PSIS or a sacrum, or both hips, here or in a static trial.",
            [Fault(name, _HIDDEN) for name in lacking],
        )
    X, Y, Z = pelvis_axes(p)
    mid_asis = (p["l_asis"] + p["r_asis"]) / 2
    width = median_distance_m(p["l_asis"], p["r_asis"])

    def pelvis_point(k: Vector3) -> Points:
        return np.asarray(mid_asis + width * (k[0] * X + k[1] * Y + k[2] * Z))

    centres = {
        "lumbar": pelvis_point(body.lumbar),
        "l_hip": p.get("l_hip_centre", pelvis_point(body.hip * (1.0, 1.0, -1.0))),
        "r_hip": p.get("r_hip_centre", pelvis_point(body.hip)),
    }
    return Joints(centres, {"pelvis": Z})


def leg_joints(p: Tracks, s: str, joints: Joints, body: Anthropometry, widths_m: Mapping[str, float]) -> Joints:
    """Knee, ankle and middle of the forefoot of side ``s``.

    Raises ``NotEstimable`` if the knee is not marked (``knee-markers-missing``), or neither the ankle nor heel and
    fifth metatarsal (``ankle-markers-missing``).
    """
    Z = joints.rightward["pelvis"]
    knee = hinge_joint(p, f"{s}_knee", joints.centres[f"{s}_hip"], Z, body, widths_m)
    if knee is None:
        raise NotEstimable(
            "knee-markers-missing",
            "The knees are not marked in this trial; add a static trial of the same person that marks them.",
            [Fault(f"{s}_knee_lateral", _HIDDEN)],
        )
    above = knee.centres[f"{s}_knee"]
    ankle = hinge_joint(p, f"{s}_ankle", above, Z, body, widths_m) or _ankle_from_foot(p, s, above, Z, body)
    facing = {f"{s}_thigh": knee.rightward[f"{s}_knee"], f"{s}_shank": ankle.rightward[f"{s}_ankle"]}
    centres = {**knee.centres, **ankle.centres}
    return Joints(centres, facing, knee.substitutes | ankle.substitutes) | _forefoot_joint(p, s)


def _ankle_from_foot(p: Tracks, s: str, knee: Points, Z: Points, body: Anthropometry) -> Joints:
    """Ankle in the frame heel -> 5th metatarsal (x), towards the knee (y), inwards; per distance heel to metatarsal."""
    if not has_landmarks(p, f"{s}_heel", f"{s}_mt5"):
        raise NotEstimable(
            "ankle-markers-missing",
            "The ankles are not marked, nor heel and fifth metatarsal from which to place them.",
            [Fault(f"{s}_ankle_lateral", _HIDDEN)],
        )
    heel, mt5 = p[f"{s}_heel"], p[f"{s}_mt5"]
    forwards, upwards, inwards = body.ankle_in_foot * median_distance_m(heel, mt5)
    x = unit(mt5 - heel)
    y = perpendicular_unit(knee - heel, x)
    rightward = cross(x, y)
    ankle = heel + forwards * x + upwards * y - OUTWARD_SIGN[s] * inwards * rightward
    return Joints({f"{s}_ankle": ankle}, {f"{s}_ankle": Z}, frozenset({"ankle-missing"}))


def _forefoot_joint(p: Tracks, s: str) -> Joints:
    """Middle of the metatarsal heads; without it, or without the heel, ``segment_frames`` simplifies the foot."""
    name, incomplete = f"{s}_forefoot", frozenset({"foot-simplified"})
    if has_landmarks(p, f"{s}_mt1", f"{s}_mt5"):
        outwards = p[f"{s}_mt5"] - p[f"{s}_mt1"]
        middle, facing = (p[f"{s}_mt1"] + p[f"{s}_mt5"]) / 2, {f"{s}_foot": OUTWARD_SIGN[s] * outwards}
        return Joints({name: middle}, facing, frozenset() if has_landmarks(p, f"{s}_heel") else incomplete)
    if has_landmarks(p, f"{s}_mt2"):
        return Joints({name: p[f"{s}_mt2"]}, {}, frozenset() if has_landmarks(p, f"{s}_heel") else incomplete)
    return Joints({}, {}, incomplete)


def trunk_joints(p: Tracks, joints: Joints, body: Anthropometry) -> Joints:
    """Cervical joint and shoulders, by the most accurate of three methods that the landmarks allow."""
    notch = _jugular_notch(p)
    if notch is not None and has_landmarks(p, "c7"):
        return _regressed_trunk(p, p["c7"], notch, joints.centres["lumbar"], body)
    if has_landmarks(p, "l_acromion", "r_acromion"):
        return _trunk_from_acromia(p, joints.centres["lumbar"], body)
    return _upright_trunk(p, joints, body)


def arm_joints(p: Tracks, s: str, joints: Joints, body: Anthropometry, widths_m: Mapping[str, float]) -> Joints:
    """Elbow, wrist and middle of the metacarpal heads of side ``s``; unmarked arms hang along the trunk."""
    c, Z = joints.centres, joints.rightward["torso"]
    shoulder, down = c[f"{s}_shoulder"], unit(c["lumbar"] - c["cervical"])
    shank = shank_length_m({**p, **_as_landmarks(c)})
    elbow = hinge_joint(p, f"{s}_elbow", shoulder, Z, body, widths_m)
    if elbow is None:
        hanging = shoulder + body.proportions["upper_arm"] * shank * down
        elbow = Joints({f"{s}_elbow": hanging}, {f"{s}_elbow": Z}, frozenset({"arms-missing"}))
    middle = elbow.centres[f"{s}_elbow"]
    upper_arm = Joints(elbow.centres, {f"{s}_upper_arm": elbow.rightward[f"{s}_elbow"]}, elbow.substitutes)
    wrist = _wrist_joint(p, s)
    if wrist is None:
        stretched = middle + body.proportions["forearm"] * shank * unit(middle - shoulder)
        code = "arms-missing" if "arms-missing" in elbow.substitutes else "hands-missing"
        wrist = Joints({f"{s}_wrist": stretched}, {}, frozenset({code}))
    return upper_arm | Joints({}, {f"{s}_forearm": Z}) | wrist | _knuckles_joint(p, s)


def head_joints(p: Tracks, joints: Joints, body: Anthropometry) -> Joints:
    """Vertex: along the axis from the cervical joint to the middle of the head markers, else along the trunk."""
    c, Z = joints.centres, joints.rightward["torso"]
    cervical = c["cervical"]
    length = median_distance_m(cervical, c["lumbar"]) * body.length_m["head"] / body.length_m["torso"]
    rims = {s: [p[f"{s}_head_{at}"] for at in ("front", "back", "side") if f"{s}_head_{at}" in p] for s in "lr"}
    sides = {s: sum(marked[1:], start=marked[0]) / len(marked) for s, marked in rims.items() if marked}
    facing = sides["r"] - sides["l"] if len(sides) == 2 else Z
    if has_landmarks(p, "head_top"):
        return Joints({"vertex": p["head_top"]}, {"head": facing})
    if len(sides) == 2:
        axis = unit((sides["l"] + sides["r"]) / 2 - cervical)
        return Joints({"vertex": cervical + length * axis}, {"head": facing})
    axis = unit(cervical - c["lumbar"])
    return Joints({"vertex": cervical + length * axis}, {"head": Z}, frozenset({"head-missing"}))


def _jugular_notch(p: Tracks) -> Points | None:
    if not has_landmarks(p, "jugular_notch") and has_landmarks(p, "l_clavicle", "r_clavicle"):
        return np.asarray((p["l_clavicle"] + p["r_clavicle"]) / 2)
    return p.get("jugular_notch")


def _regressed_trunk(p: Tracks, c7: Points, notch: Points, lumbar: Points, body: Anthropometry) -> Joints:
    """Trunk by regression: x from C7 to the notch, z normal to their plane with the lumbar joint, w = |C7 - notch|."""
    x = unit(notch - c7)
    z = unit(cross(x, c7 - lumbar))
    y = cross(z, x)
    w = median_distance_m(c7, notch)

    def trunk_offset(k: SagittalOffset) -> Points:
        angle = radians(k.angle_deg)
        return w * k.scale * (cos(angle) * x + sin(angle) * y)

    cervical = c7 + trunk_offset(body.cervical)
    shoulders = {s: p[f"{s}_acromion"] + trunk_offset(body.shoulder) for s in "lr" if has_landmarks(p, f"{s}_acromion")}
    return _with_shoulders(p, cervical, shoulders, lumbar, z, body)


def _trunk_from_acromia(p: Tracks, lumbar: Points, body: Anthropometry) -> Joints:
    """Trunk by mean proportions: z along the acromia, y up from the lumbar joint, w the distance of the acromia."""
    middle = (p["l_acromion"] + p["r_acromion"]) / 2
    z = unit(p["r_acromion"] - p["l_acromion"])
    y = perpendicular_unit(middle - lumbar, z)
    x = cross(y, z)
    w = median_distance_m(p["l_acromion"], p["r_acromion"])

    def trunk_offset(k: Vector3) -> Points:
        return np.asarray(w * (k[0] * x + k[1] * y + k[2] * z))

    cervical = middle + trunk_offset(body.cervical_from_acromia)
    shoulders = {
        s: p[f"{s}_acromion"] + trunk_offset(body.shoulder_from_acromion * (1, 1, OUTWARD_SIGN[s])) for s in "lr"
    }
    trunk = _with_shoulders(p, cervical, shoulders, lumbar, z, body)
    return trunk | Joints({}, {}, frozenset({"trunk-simplified"}))


def _upright_trunk(p: Tracks, joints: Joints, body: Anthropometry) -> Joints:
    """Vertical trunk above the lumbar joint, with the orientation of the pelvis; length from stature or shank."""
    lumbar = joints.centres["lumbar"]
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), lumbar.shape)
    cervical = lumbar + _torso_length_m(p, joints, body) * up
    z = perpendicular_unit(joints.rightward["pelvis"], up)
    trunk = _with_shoulders(p, cervical, {}, lumbar, z, body)
    return trunk | Joints({}, {}, frozenset({"trunk-missing"}))


def _torso_length_m(p: Tracks, joints: Joints, body: Anthropometry) -> float:
    if body.height_m is not None:
        return body.torso_per_stature * body.height_m
    return body.proportions["torso"] * shank_length_m({**p, **_as_landmarks(joints.centres)})


def _with_shoulders(
    p: Tracks, cervical: Points, shoulders: Tracks, lumbar: Points, z: Points, body: Anthropometry
) -> Joints:
    """Shoulder centres of the file if given, else ``shoulders``, else the mean position of a shoulder in the trunk."""
    y = unit(cervical - lumbar)
    x, length = cross(y, z), median_distance_m(cervical, lumbar)
    kx, ky, kz = body.shoulder_in_torso * length
    centres = {"cervical": cervical}
    for s in "lr":
        mean = cervical + kx * x + ky * y + OUTWARD_SIGN[s] * kz * z
        centres[f"{s}_shoulder"] = p.get(f"{s}_shoulder_centre", shoulders.get(s, mean))
    return Joints(centres, {"torso": z})


def _wrist_joint(p: Tracks, s: str) -> Joints | None:
    radial, ulnar, centre = (p.get(f"{s}_wrist_{kind}") for kind in ("radial", "ulnar", "centre"))
    if radial is not None and ulnar is not None:
        middle = (radial + ulnar) / 2 if centre is None else centre
        return Joints({f"{s}_wrist": middle}, {f"{s}_forearm": OUTWARD_SIGN[s] * (radial - ulnar)})
    single = next((track for track in (centre, radial, ulnar) if track is not None), None)
    return None if single is None else Joints({f"{s}_wrist": single}, {})


def _knuckles_joint(p: Tracks, s: str) -> Joints:
    if has_landmarks(p, f"{s}_mc2", f"{s}_mc5"):
        middle = (p[f"{s}_mc2"] + p[f"{s}_mc5"]) / 2
        return Joints({f"{s}_knuckles": middle}, {f"{s}_hand": OUTWARD_SIGN[s] * (p[f"{s}_mc2"] - p[f"{s}_mc5"])})
    single = p.get(f"{s}_mc2", p.get(f"{s}_mc5"))
    return Joints({} if single is None else {f"{s}_knuckles": single}, {})


def _as_landmarks(centres: Tracks) -> dict[str, Points]:
    return {f"{name}_centre": track for name, track in centres.items() if name[2:] in ("knee", "ankle")}
