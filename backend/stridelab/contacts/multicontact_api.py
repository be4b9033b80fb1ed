"""Import and export of contact sequences as JSON with the field names of multicontact-api's archives.

multicontact-api (LAAS) stores a sequence as phases with absolute times, each with one patch per effector in contact:
a placement, a friction coefficient and a contact model. docs/contact-sequences.md has the table of fields. Data without
a field there (the terrain, the robot, names) is stored under ``stridelab``; trajectories are neither written nor read.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import sole_points_m
from stridelab.contacts.scenario_io import scenario_of
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.validation.parse import contact_field
from stridelab.errors import Fault, InvalidInput

GAP_TOLERANCE_S: Final = 1e-6
"""Gaps and overlaps of consecutive phases below this are ignored."""
ROTATION_TOLERANCE: Final = 1e-3
"""Largest entry of ``R^T R - 1`` accepted in a rotation."""
MAX_NAME_LENGTH: Final = 60
"""Effector names are truncated to this length; no robot has longer ones."""
TYPES: Final = {"surface": "CONTACT_PLANAR", "point": "CONTACT_POINT"}


def to_multicontact(sequence: ContactSequence, description: str = "") -> dict[str, Any]:
    """Return the document of a contact sequence; times start at 0."""
    scenario = scenario_of(sequence, description)
    return {
        "contact_phases": [
            {
                "t_init": float(start),
                "t_final": float(end),
                "effector_in_contact": list(phase.contacts),
                "contact_patches": {name: _contact_patch(contact) for name, contact in phase.contacts.items()},
            }
            for phase, start, end in zip(sequence.phases, sequence.starts_s, sequence.ends_s, strict=True)
        ],
        "stridelab": {key: value for key, value in scenario.items() if key != "phases"},
    }


def from_multicontact(document: Mapping[str, Any], fallback: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the scenario (``schemas.scenarios.Scenario`` as a mapping) of a document; it is not validated yet.

    ``fallback`` supplies fields that the document lacks (``name``, ``robot``, ``terrain``, ``friction``); values under
    the document's ``stridelab`` take precedence. Friction coefficients of the patches are ignored: friction belongs to
    surfaces. Raises ``InvalidInput`` (``contact-sequence-invalid``) with one fault per phase or contact that cannot be
    read: overlapping phases, gaps, times or placements that are not numbers, patches without a placement.
    """
    faults: list[Fault] = []
    phases: list[dict[str, Any]] = []
    ended_s: float | None = None
    entries = document.get("contact_phases")
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise _sequence_invalid([Fault("contact_phases", "there are no phases")])
    for k, entry in enumerate(entries):
        if not isinstance(entry, Mapping):
            faults.append(Fault(f"phases[{k}]", "it is not a phase"))
            continue
        times = _times_s(k, entry, ended_s, faults)
        ended_s = times[1] if times else None
        phases.append({"duration_s": round(times[1] - times[0], 9) if times else None, "contacts": []})
        phases[-1]["contacts"] = list(_read_contacts(k, entry, faults))
    if faults:
        raise _sequence_invalid(faults)
    defaults = {**(fallback or {}), **_as_mapping(document.get("stridelab"))}
    missing = [key for key in ("robot", "terrain") if not defaults.get(key)]
    if missing:
        raise _sequence_invalid([Fault(key, "missing in the document and not given separately") for key in missing])
    return {"name": "Imported", "description": "", "friction": 0.3, **defaults, "phases": phases}


def _contact_patch(contact: Contact) -> dict[str, Any]:
    points = sole_points_m(contact.half_size_m)[:4]
    return {
        "placement": {
            "translation": contact.placement.position_m.tolist(),
            "rotation": contact.placement.rotation.tolist(),
        },
        "contact_model": {
            "mu": contact.friction,
            "contact_type": TYPES[contact.kind],
            "num_contact_points": len(points),
            "contact_points_positions": points.T.tolist(),
        },
    }


def _times_s(
    k: int, entry: Mapping[str, Any], ended_s: float | None, faults: list[Fault]
) -> tuple[float, float] | None:
    """Start and end of a phase; faults if it overlaps the previous one or leaves a gap."""
    where = f"phases[{k}]"
    try:
        start, end = (float(entry[key]) for key in ("t_init", "t_final"))
    except (KeyError, TypeError, ValueError, OverflowError):
        faults.append(Fault(where, "t_init and t_final must be numbers"))
        return None
    if not (math.isfinite(start) and math.isfinite(end)):
        faults.append(Fault(where, "t_init and t_final must be finite"))
        return None
    if end <= start:
        faults.append(Fault(where, f"it ends at {end:g} s, not after its start at {start:g} s"))
    if ended_s is not None and start < ended_s - GAP_TOLERANCE_S:
        faults.append(
            Fault(where, f"overlaps phase {k - 1}: it starts at {start:g} s, before that one ends at {ended_s:g} s")
        )
    if ended_s is not None and start > ended_s + GAP_TOLERANCE_S:
        faults.append(Fault(where, f"leaves a gap of {start - ended_s:.4g} s after phase {k - 1}"))
    return start, end


def _read_contacts(k: int, entry: Mapping[str, Any], faults: list[Fault]) -> list[dict[str, Any]]:
    patches = _as_mapping(entry.get("contact_patches"))
    named = entry.get("effector_in_contact", list(patches))
    if not isinstance(named, Sequence) or isinstance(named, str):
        faults.append(Fault(f"phases[{k}].effector_in_contact", "it is not a list of effectors"))
        return []
    names = [str(name)[:MAX_NAME_LENGTH] for name in named]
    contacts = []
    for i, name in enumerate(names):
        if name in names[:i]:
            faults.append(Fault(contact_field(k, name), "the same effector is named twice"))
            continue
        try:
            contacts.append(_read_contact(name, patches[name]["placement"]))
        except (KeyError, TypeError):
            faults.append(Fault(contact_field(k, name), "it is in contact, but has no patch with a placement"))
        except (ValueError, OverflowError) as error:
            faults.append(Fault(contact_field(k, name), str(error)))
    return contacts


def _read_contact(name: str, placement: Mapping[str, Any]) -> dict[str, Any]:
    position = np.asarray(placement["translation"], dtype=float)
    R = np.asarray(placement["rotation"], dtype=float)
    if position.shape != (3,) or R.shape != (3, 3):
        raise ValueError("translation must have three numbers, rotation three rows of three")
    if not (np.isfinite(position).all() and np.isfinite(R).all()):
        raise ValueError("translation and rotation must be finite")
    if np.abs(R.T @ R - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise ValueError("rotation is not a rotation matrix")
    wxyz = ScipyRotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    return {"effector": name, "position_m": position.tolist(), "orientation_wxyz": wxyz.tolist()}


def _as_mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _sequence_invalid(faults: Sequence[Fault]) -> InvalidInput:
    first = faults[0]
    message = f"The contact sequence cannot be read: {first.where}: {first.message}."
    return InvalidInput("contact-sequence-invalid", message, tuple(faults))
