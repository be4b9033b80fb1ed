"""Bodies that stand and walk by formulas.

A walk with exact contacts, made of formulas: feet that stand, swing and land at known instants, plates under some.

The vertical force is body weight at all times (a walker on wheels); what matters here is where it is measured.

A body whose vertical motion and force are known exactly: a sit-to-stand, a drop jump, a stand, on one plate.

A made-up body with the landmarks of a full marker set, walking in place; its sides are mirror images.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.recordings.recording import Plate, Recording, Subject

STEP_M, STEP_S, STANCE_S = 0.6, 0.5, 0.6
"""Step length and time of one foot after the other; each foot stands for 0.6 s of every 1.0 s."""
WEIGHT_N = 700.0
LANDMARKS = {f"{side}_{name}": f"{side}_{name}" for side in "lr" for name in ("heel", "mt1", "mt5")}
FOOT = {"heel": (0.0, 0.0, 0.03), "mt1": (0.18, 0.04, 0.03), "mt5": (0.15, -0.04, 0.03)}


@dataclass(frozen=True)
class Contact:
    """One stance: from ``start_s`` to ``end_s`` with the heel at ``heel_m``."""

    side: str
    start_s: float
    end_s: float
    heel_m: np.ndarray


def contacts(n_steps: int) -> list[Contact]:
    """Stance k of alternating feet: it starts at k times 0.5 s - 0.3 s, 0.6 m further each time."""
    phases = []
    for k in range(n_steps):
        side = "lr"[k % 2]
        y = 0.1 if side == "l" else -0.1
        phases.append(Contact(side, STEP_S * k - 0.3, STEP_S * k - 0.3 + STANCE_S, np.array([STEP_M * k, y, 0.0])))
    return phases


def foot_position(stances: list[Contact], time_s: np.ndarray) -> np.ndarray:
    """Heel of one foot: still while it stands, at constant speed on an arc between stances."""
    x = np.zeros((len(time_s), 3))
    for a, b in itertools.pairwise(stances):
        swing = (time_s >= a.end_s) & (time_s < b.start_s)
        share = (time_s[swing] - a.end_s) / (b.start_s - a.end_s)
        rise = np.outer(np.sin(np.pi * share), [0.0, 0.0, 0.12])
        x[swing] = a.heel_m + share[:, None] * (b.heel_m - a.heel_m) + rise
    for stance in stances:
        x[(time_s >= stance.start_s) & (time_s < stance.end_s)] = stance.heel_m
    return x


def corners(centre_m: Sequence[float], size_m: tuple[float, float] = (0.58, 0.5)) -> np.ndarray:
    x, y, z = centre_m
    a, b = size_m[0] / 2, size_m[1] / 2
    return np.array([[x - a, y + b, z], [x + a, y + b, z], [x + a, y - b, z], [x - a, y - b, z]])


def walk(
    plates_under: Sequence[int], *, n_steps: int = 7, rate_hz: float = 100.0, force_rate_hz: float = 1000.0
) -> Recording:
    """A walk of ``n_steps`` stances with a plate under each stance whose number is in ``plates_under``."""
    duration_s = STEP_S * (n_steps - 1)
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    force_time_s = np.arange(round(duration_s * force_rate_hz)) / force_rate_hz
    stances = contacts(n_steps + 2)
    markers = {}
    for side in "lr":
        heel = foot_position([c for c in stances if c.side == side], time_s)
        for name, offset in FOOT.items():
            markers[f"{side}_{name}"] = heel + offset
    pelvis = np.column_stack([STEP_M / STEP_S * time_s, 0 * time_s, 0.95 + 0 * time_s])
    markers |= {f"pelvis_{k}": pelvis + np.array([0.0, 0.1 * k - 0.2, 0.02 * k]) for k in range(5)}
    plates = []
    for index, k in enumerate(plates_under, start=1):
        c = stances[k]
        force = np.zeros((len(force_time_s), 3))
        force[:, 2] = WEIGHT_N * share_of_weight(c, stances, force_time_s)
        cop = c.heel_m + np.array([0.09, 0.0, 0.0])
        plates.append(
            Plate(index, 2, corners(c.heel_m * [1, 0, 1] + [0.09, 0, 0]), force, np.cross(cop, force), np.zeros(3))
        )
    return Recording(markers, rate_hz, force_rate_hz, tuple(plates), Subject(), (), "+z", np.array([1.0, 0.0, 0.0]))


def heel_first(recording: Recording) -> Recording:
    """The walk with its forefeet 30 ms later: the heels strike first, where those of ``walk`` land flat."""
    moved = {
        label: delayed_track(track, 3) if label[2:] in ("mt1", "mt5") else track
        for label, track in recording.markers_m.items()
    }
    return replace(recording, markers_m=moved)


def delayed(recording: Recording, frames: int) -> Recording:
    """The recording with all markers ``frames`` frames late."""
    markers = {label: delayed_track(track, frames) for label, track in recording.markers_m.items()}
    return replace(recording, markers_m=markers)


def delayed_track(track: Points, frames: int) -> Points:
    return np.vstack([track[:frames], track[: len(track) - frames]])


def share_of_weight(contact: Contact, stances: list[Contact], time_s: np.ndarray) -> np.ndarray:
    """1 in single support, shared linearly in double support; all shares add to 1."""
    double_s = STANCE_S - STEP_S
    rise = np.clip((time_s - contact.start_s) / double_s, 0.0, 1.0)
    fall = np.clip((contact.end_s - time_s) / double_s, 0.0, 1.0)
    return np.minimum(rise, fall)


MASS_KG = 64.0
RATE_HZ, FORCE_RATE_HZ = 100.0, 1000.0


@dataclass(frozen=True)
class MovingBody:
    """The recording, its centre of mass (frames x 3), and the share of body weight that something else carries."""

    recording: Recording
    com_m: Points
    beside: Series


def moving_body(
    height_m: Callable[[Series], Series], beside: Callable[[Series], Series], duration_s: float
) -> MovingBody:
    """Both feet rest on one plate, and the centre of mass is at ``height_m`` of the time.

    The plate measures m (g + z'') less the share ``beside`` of the body weight that a chair or a box carries.
    """
    force_s = np.arange(round(duration_s * FORCE_RATE_HZ)) / FORCE_RATE_HZ
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    lift = np.gradient(np.gradient(height_m(force_s))) * FORCE_RATE_HZ**2
    force = np.zeros((len(force_s), 3))
    force[:, 2] = np.maximum(MASS_KG * (GRAVITY_M_S2 * (1.0 - beside(force_s)) + lift), 0.0)
    markers = {
        f"{side}_{name}": np.tile(np.add(offset, [0.0, y, 0.0]), (len(time_s), 1))
        for side, y in (("l", 0.1), ("r", -0.1))
        for name, offset in FOOT.items()
    }
    com = np.column_stack([0.05 + 0 * time_s, 0 * time_s, height_m(time_s)])
    markers |= {"pelvis": com.copy()}
    plate = Plate(1, 2, corners((0.1, 0.0, 0.0), (0.6, 0.6)), force, np.cross([0.05, 0.0, 0.0], force), np.zeros(3))
    recording = Recording(markers, RATE_HZ, FORCE_RATE_HZ, (plate,), Subject(), (), "+z", None)
    return MovingBody(recording, com, beside(time_s))


def smooth_step(time_s: Series, start_s: float, end_s: float) -> Series:
    """From 0 to 1 with no velocity and no acceleration at either end."""
    x = np.clip((time_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


def sit_to_stand() -> MovingBody:
    """Sits until 1.5 s (nine tenths on a chair beside the plate), has left the chair at 1.9 s, stands from 2.8 s on."""
    return moving_body(
        lambda t: 0.62 + 0.35 * smooth_step(t, 1.4, 2.8),
        lambda t: 0.9 * (1.0 - smooth_step(t, 1.5, 1.9)),
        duration_s=4.5,
    )


def stand() -> MovingBody:
    """Stands still, with a sway of 1 mm."""
    return moving_body(lambda t: 0.95 + 0.001 * np.sin(2.0 * t), np.zeros_like, duration_s=3.0)


DROP_S, LANDED_S, STOOD_S = 0.6, 0.9, 1.5
"""The jumper leaves a box, reaches the plate, and has come to rest."""


def drop_jump() -> MovingBody:
    """Stands on a box until 0.6 s, falls for 0.3 s beside nothing, and is stopped within 0.6 s on the plate."""
    speed_m_s = GRAVITY_M_S2 * (LANDED_S - DROP_S)

    def height_m(t: Series) -> Series:
        fallen = 0.5 * GRAVITY_M_S2 * np.clip(t - DROP_S, 0.0, LANDED_S - DROP_S) ** 2
        x = np.clip((t - LANDED_S) / (STOOD_S - LANDED_S), 0.0, 1.0)
        braked = speed_m_s * (STOOD_S - LANDED_S) * (x - x**3 + 0.5 * x**4)
        return np.asarray(1.6 - fallen - braked)

    body = moving_body(height_m, lambda t: (t < DROP_S).astype(float), duration_s=3.0)
    on_box = body.recording.time_s < DROP_S
    falling = np.clip(body.recording.time_s - DROP_S, 0.0, LANDED_S - DROP_S)
    above_m = 0.5 * GRAVITY_M_S2 * ((LANDED_S - DROP_S) ** 2 - falling**2)
    markers = {
        label: track
        if label == "pelvis"
        else track + np.outer(above_m, [0.0, 0.0, 1.0]) - np.outer(on_box, [0.8, 0, 0])
        for label, track in body.recording.markers_m.items()
    }
    return replace(body, recording=replace(body.recording, markers_m=markers))


STANDING_RATE_HZ = 100.0

_MEDIAN = {
    "sacrum": (-0.10, 1.02),
    "c7": (-0.07, 1.50),
    "t10": (-0.11, 1.28),
    "jugular_notch": (0.06, 1.42),
    "xiphoid": (0.10, 1.25),
    "head_top": (0.00, 1.75),
}
_LEFT = {
    "asis": (0.09, 0.12, 1.00),
    "psis": (-0.10, 0.04, 1.02),
    "trochanter": (0.01, 0.17, 0.92),
    "knee_lateral": (0.00, 0.15, 0.50),
    "knee_medial": (0.00, 0.05, 0.50),
    "fibula_head": (-0.02, 0.14, 0.45),
    "tibial_tuberosity": (0.05, 0.10, 0.45),
    "ankle_lateral": (-0.01, 0.14, 0.08),
    "ankle_medial": (0.00, 0.06, 0.09),
    "heel": (-0.07, 0.10, 0.04),
    "mt1": (0.13, 0.06, 0.04),
    "mt2": (0.14, 0.09, 0.04),
    "mt5": (0.11, 0.14, 0.03),
    "clavicle": (0.06, 0.02, 1.42),
    "acromion": (-0.02, 0.18, 1.43),
    "elbow_lateral": (-0.03, 0.29, 1.12),
    "elbow_medial": (-0.03, 0.21, 1.12),
    "wrist_radial": (0.13, 0.24, 0.93),
    "wrist_ulnar": (0.08, 0.25, 0.91),
    "mc2": (0.18, 0.24, 0.86),
    "mc5": (0.13, 0.26, 0.84),
    "head_front": (0.09, 0.06, 1.64),
    "head_back": (-0.09, 0.06, 1.64),
}
_SWINGING = {
    "knee": 0.10,
    "ankle": 0.20,
    "heel": 0.20,
    "mt": 0.20,
    "fibula": 0.12,
    "tibial": 0.12,
    "wrist": -0.15,
    "mc": -0.18,
}


def landmarks(n_frames: int = 5) -> dict[str, np.ndarray]:
    """Tracks (n, 3) of all landmarks; the legs swing fore and aft, the arms against them."""
    phase = np.sin(np.linspace(0.0, 2.0, n_frames))
    tracks = {}
    for name, (x, z) in _MEDIAN.items():
        tracks[name] = np.tile([x, 0.0, z], (n_frames, 1))
    for name, (x, y, z) in _LEFT.items():
        swing = next((share for part, share in _SWINGING.items() if name.startswith(part)), 0.0)
        for side, sign in (("l", 1.0), ("r", -1.0)):
            track = np.tile([x, sign * y, z], (n_frames, 1))
            track[:, 0] += sign * swing * phase
            tracks[f"{side}_{name}"] = track
    return tracks


def recording(tracks: dict[str, np.ndarray], **fields: object) -> Recording:
    """A recording whose labels are the landmark names."""
    bare = Recording(
        markers_m=tracks,
        marker_rate_hz=STANDING_RATE_HZ,
        force_rate_hz=1000.0,
        plates=(),
        subject=Subject(height_m=1.75, mass_kg=70.0, sex="male"),
        events=(),
        up_axis="+z",
        walking_direction=None,
    )
    return replace(bare, **fields)  # type: ignore[arg-type]


def mirrored_tracks(tracks: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The body seen in a mirror: y changes sign, sides swap names."""
    other = {"l_": "r_", "r_": "l_"}
    return {other.get(name[:2], name[:2]) + name[2:]: track * [1.0, -1.0, 1.0] for name, track in tracks.items()}


def link_adults(gait: Path, people: Sequence[str], folder: Path) -> Path:
    """Link the recordings of some adults of ``gait`` into ``folder``, as that of all; returns ``folder``."""
    link_people(gait / "rehazenter-adult-walking", people, folder / "rehazenter-adult-walking")
    return folder


def link_people(study: Path, people: Sequence[str], folder: Path) -> None:
    """Link the files of some people of ``study`` into ``folder``, which is made.

    Each file has its own link: through one to a folder, a test that removes a file would remove the recording itself.
    """
    for person in people:
        (folder / person).mkdir(parents=True)
        for path in (study / person).iterdir():
            (folder / person / path.name).symlink_to(path.resolve())


def cut_recording(gait: Path, folder: Path, pattern: str, person: str = "cut") -> Path:
    """Copy the first half of a recording that matches ``pattern`` to ``folder`` as that of another person."""
    whole = sorted(gait.glob(pattern))[0]
    cut = folder / whole.parent.parent.name / person / whole.name
    cut.parent.mkdir(parents=True, exist_ok=True)
    content = whole.read_bytes()
    cut.write_bytes(content[: len(content) // 2])
    return cut
