"""Joint centres of pelvis and legs. Hips and lumbar joint by regression (Dumas and Wojtusch 2018), the rest midway."""

from collections.abc import Mapping

import numpy as np

from stridelab.body.anthropometry import Anthropometry
from stridelab.body.hinge import hinge
from stridelab.body.joints import SIGN, Joints, Tracks, has
from stridelab.body.vectors import across, distance_m, unit
from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, NotEstimable

_HIDDEN = "This landmark is not marked, or hardly ever visible."


def pelvis_axes(p: Tracks) -> tuple[Points, Points, Points]:
    """ISB pelvis axes: Z from left to right ASIS, Y normal to the plane of ASIS and PSIS, X forwards (Wu 2002)."""
    mid_asis = (p["l_asis"] + p["r_asis"]) / 2
    mid_psis = (p["l_psis"] + p["r_psis"]) / 2 if has(p, "l_psis", "r_psis") else p["sacrum"]
    Z = unit(p["r_asis"] - p["l_asis"])
    Y = unit(np.cross(Z, mid_asis - mid_psis))
    return np.cross(Y, Z), Y, Z


def pelvis(p: Tracks, body: Anthropometry) -> Joints:
    """Lumbar joint and hips: c = mid-ASIS + w (k_x X + k_y Y + k_z Z), w the distance between the ASIS.

    Raises ``NotEstimable`` (``pelvis-markers-missing``) without both ASIS and either both PSIS or a sacrum marker.
    """
    lacking = [name for name in ("l_asis", "r_asis") if name not in p]
    if not (has(p, "l_psis", "r_psis") or has(p, "sacrum")):
        lacking.append("l_psis")
    if lacking:
        raise NotEstimable(
            "pelvis-markers-missing",
            "The pelvis cannot be located: both ASIS, and both PSIS or a sacrum marker, are needed.",
            [Fault(name, _HIDDEN) for name in lacking],
        )
    X, Y, Z = pelvis_axes(p)
    mid_asis = (p["l_asis"] + p["r_asis"]) / 2
    width = distance_m(p["l_asis"], p["r_asis"])

    def at(k: Vector3) -> Points:
        return np.asarray(mid_asis + width * (k[0] * X + k[1] * Y + k[2] * Z))

    centres = {
        "lumbar": at(body.lumbar),
        "l_hip": p.get("l_hip_centre", at(body.hip * (1.0, 1.0, -1.0))),
        "r_hip": p.get("r_hip_centre", at(body.hip)),
    }
    return Joints(centres, {"pelvis": Z})


def leg(p: Tracks, s: str, joints: Joints, body: Anthropometry, widths_m: Mapping[str, float]) -> Joints:
    """Knee, ankle and middle of the forefoot of side ``s``.

    Raises ``NotEstimable`` where the knee is not marked (``knee-markers-missing``), or neither the ankle nor heel and
    forefoot (``ankle-markers-missing``).
    """
    Z = joints.rightward["pelvis"]
    knee = hinge(p, f"{s}_knee", joints.centres[f"{s}_hip"], Z, body, widths_m)
    if knee is None:
        raise NotEstimable(
            "knee-markers-missing",
            "The knees are not marked in this trial; add a static trial of the same person that marks them.",
            [Fault(f"{s}_knee_lateral", _HIDDEN)],
        )
    above = knee.centres[f"{s}_knee"]
    ankle = hinge(p, f"{s}_ankle", above, Z, body, widths_m) or _ankle_from_foot(p, s, above, Z, body)
    facing = {f"{s}_thigh": knee.rightward[f"{s}_knee"], f"{s}_shank": ankle.rightward[f"{s}_ankle"]}
    centres = {**knee.centres, **ankle.centres}
    return Joints(centres, facing, knee.substitutes | ankle.substitutes) | _forefoot(p, s)


def _ankle_from_foot(p: Tracks, s: str, knee: Points, Z: Points, body: Anthropometry) -> Joints:
    """Ankle in the frame heel -> 5th metatarsal (x), towards the knee (y), inwards; per distance heel to metatarsal."""
    if not has(p, f"{s}_heel", f"{s}_mt5"):
        raise NotEstimable(
            "ankle-markers-missing",
            "The ankles are not marked, nor heel and fifth metatarsal from which to place them.",
            [Fault(f"{s}_ankle_lateral", _HIDDEN)],
        )
    heel, mt5 = p[f"{s}_heel"], p[f"{s}_mt5"]
    forwards, upwards, inwards = body.ankle_in_foot * distance_m(heel, mt5)
    x = unit(mt5 - heel)
    y = across(knee - heel, x)
    rightward = np.cross(x, y)
    ankle = heel + forwards * x + upwards * y - SIGN[s] * inwards * rightward
    return Joints({f"{s}_ankle": ankle}, {f"{s}_ankle": Z}, frozenset({"ankle-missing"}))


def _forefoot(p: Tracks, s: str) -> Joints:
    """Middle of the metatarsal heads; a foot that lacks it, or the heel, is completed in ``frames``."""
    name, incomplete = f"{s}_forefoot", frozenset({"foot-simplified"})
    if has(p, f"{s}_mt1", f"{s}_mt5"):
        outwards = p[f"{s}_mt5"] - p[f"{s}_mt1"]
        middle, facing = (p[f"{s}_mt1"] + p[f"{s}_mt5"]) / 2, {f"{s}_foot": SIGN[s] * outwards}
        return Joints({name: middle}, facing, frozenset() if has(p, f"{s}_heel") else incomplete)
    if has(p, f"{s}_mt2"):
        return Joints({name: p[f"{s}_mt2"]}, {}, frozenset() if has(p, f"{s}_heel") else incomplete)
    return Joints({}, {}, incomplete)
