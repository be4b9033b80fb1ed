"""Fit the weights with which sinking feet land later, and judge them on sources that are left out; print both.

make_strike_timing.py FETCHED FOLDER...    the list as scripts/strangers fetches it; further sources, of C3D files

The difference of a strike on a plate from the crossing of the limit of speed (``walking.gait_events``) is regressed on
the vertical velocities of heel and forefoot over the walking speed, around the crossing. Marker placement, shoes and
delays give every recording its own constant, so that only differences within a recording inform the weights; all
sources weigh the same. The table leaves out each source in turn.
"""

import sys
import tempfile
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np

from make_event_table import latency_s
from strangers_list import read_list
from stridelab.conventions import Series
from stridelab.errors import StridelabError
from stridelab.recordings.foot_contact import find_feet, foot_outline
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import mean_visible, outline_off_plates
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Side
from stridelab.walking import gait_events
from stridelab.walking.event_calibration import MARKER_ERROR, MAX_SHIFT_S, PlateDifference, common_difference
from stridelab.walking.gait_events import (
    MAX_SINKING_S,
    SINKING_WEIGHTS_S,
    STRIKE_DELAY_S,
    contacts_of_foot,
    find_contacts,
    landing_velocities,
)
from stridelab.walking.marker_kinematics import smooth_velocity_m_s, walking_speed_m_s
from stridelab.walking.preconditions import require_walk

NEAR_S = 0.15
PENALTY = 30.0
"""Of the squared weights of standardised velocities, where every source has the total weight of the root of its n."""
OUTLIER_S = 0.008
"""Residual beyond which a strike weighs less (Huber)."""
LEAST_ON_PLATES = 0.9
MOST_RECORDINGS = 14
"""Of one repository."""
HELD_OUT: Final = (
    "fmoissenet/GaitEventsAlgorithms",
    "basgoncalves/ceinms_tutorial",
    "basgoncalves/bip_opensim_hungarian_usports",
    "Roosje95/AGED_gait-event-detection",
    "etoshey/pyc3dtools",
    "linkedinyou/c3d2OpenSim",
)
"""Repositories that judge the weights."""
SAME_SOURCE = {
    "PhilD001/biomechZoo": "biomechzoo-sample-study",
    "mcgillmotionlab/biomechzoo": "biomechzoo-sample-study",
    "demotu/BMC": "BMClab/BMC",
    "SintMaartenskliniek/OMCS_GaitAnalysis": "CarmenEnsink/OMCS_GaitAnalysis",
    "aaronsfox/zmp-opensim": "rehazenter-adult-walking",
    "antoinefalisse/3dpredictsim": "antoinefalisse/predictsim_mtp",
}
"""Repositories with recordings of one laboratory."""


@dataclass(frozen=True)
class Strike:
    """One strike on a plate: how late the crossing is, and the relative vertical velocities around it."""

    source: str
    recording: str
    side: Side
    at_s: float
    speed_m_s: float
    late_s: float
    up: Series


@dataclass(frozen=True)
class Timing:
    """Weights in seconds per relative velocity, the weighted sum of a median landing, and the delay of the strike."""

    weights_s: Series
    mean_s: float
    delay_s: float

    def late_s(self, strike: Strike) -> float:
        """How late the corrected strike is."""
        sinking_s = float(strike.up @ self.weights_s) - self.mean_s
        return strike.late_s + self.delay_s - float(np.clip(sinking_s, -MAX_SINKING_S, MAX_SINKING_S))


def main() -> None:
    """Read the folders of the command line, print the weights and the table."""
    listed = listed_strikes(Path(sys.argv[1]))
    files = [(folder, path) for folder in map(Path, sys.argv[2:]) for path in sorted(folder.rglob("*.c3d"))]
    further = (strike for folder, path in files for strike in tried_strikes(folder.name, path))
    strikes = without_copies((*listed, *further))
    fitted = fit_timing(strikes)
    np.set_printoptions(precision=2, suppress=True)
    sys.stdout.write(f"weights, ms: {1e3 * fitted.weights_s}\n")
    sys.stdout.write(f"mean {1e3 * fitted.mean_s:.1f} ms, delay {1e3 * fitted.delay_s:.1f} ms\n\n")
    sys.stdout.write("| source left out | strikes | within 15 ms | shifted |\n| --- | --- | --- | --- |\n")
    alone_s: list[float] = []
    shifted_s: list[float] = []
    for source in sorted({strike.source for strike in strikes}):
        timing = fit_timing([strike for strike in strikes if strike.source != source])
        own = [(strike.recording, timing.late_s(strike)) for strike in strikes if strike.source == source]
        late_s, rest_s = [late for _, late in own], without_common(own)
        sys.stdout.write(f"| {source} | {len(own)} | {share(late_s)} | {share(rest_s)} |\n")
        alone_s, shifted_s = alone_s + late_s, shifted_s + rest_s
    sys.stdout.write(f"| all | {len(alone_s)} | {share(alone_s)} | {share(shifted_s)} |\n")


def share(late_s: list[float]) -> str:
    """Percentage within 15 ms, with the number."""
    return f"{100 * np.mean(np.abs(late_s) <= 0.015):.0f} % of {len(late_s)}" if late_s else "-"


def listed_strikes(folder: Path) -> Iterator[Strike]:
    """Strikes of the listed walks with plates that informed the weights, fetched into ``folder``."""
    read: Counter[str] = Counter()
    for entry in read_list():
        path = folder / entry.place / entry.path
        is_walk = entry.outcome == "fused" and not entry.is_running and "static" not in entry.path.lower()
        if not is_walk or entry.plates < 1 or entry.repository in HELD_OUT or not path.exists():
            continue
        read[entry.repository] += 1
        if read[entry.repository] <= MOST_RECORDINGS:
            others = [folder / entry.place / other for other in entry.others]
            yield from tried_strikes(SAME_SOURCE.get(entry.repository, entry.repository), path, others)


def tried_strikes(source: str, path: Path, others: Sequence[Path] = ()) -> list[Strike]:
    """Strikes of one recording with the files ``others``; none if it cannot be read or is no walk."""
    with tempfile.TemporaryDirectory() as scratch:
        whole = path
        if others:
            whole = Path(scratch) / f"{path.stem}.zip"
            with zipfile.ZipFile(whole, "w") as archive:
                for part in (path, *others):
                    archive.write(part, part.name)
        try:
            return list(strikes_of(source, path, read_recording(whole)))
        except StridelabError as error:
            sys.stderr.write(f"{path.name}: {error.message}\n")
            return []


def without_copies(strikes: Iterable[Strike]) -> list[Strike]:
    """Strikes of recordings that a source publishes twice count once."""
    first: dict[tuple[str, str, int, int], Strike] = {}
    for strike in strikes:
        key = (strike.source, strike.side, round(1e2 * strike.at_s), round(10 * strike.speed_m_s))
        if key not in first or first[key].recording == strike.recording:
            first[key] = strike
    return list(first.values())


def strikes_of(source: str, path: Path, recording: Recording) -> Iterator[Strike]:
    """Strikes of the whole stances on plates of one recording."""
    landmarks = dict(identify(list(recording.markers_m)).landmarks)
    plates = [plate for plate in recording.plates if plate.use]
    feet = {foot.side: foot for foot in find_feet(recording, landmarks)}
    if not feet or not plates:
        return
    contacts = find_contacts(recording, landmarks, latency_s=latency_s(recording, landmarks))
    require_walk(recording, landmarks, contacts)
    for contact in contacts:
        if (contact.strike_source, contact.lift_off_source) != ("plates", "plates") or contact.strike_s is None:
            continue
        foot = feet[contact.side]
        stance = (recording.time_s > contact.start_s) & (recording.time_s < contact.end_s)
        off = outline_off_plates(recording, plates, foot, foot_outline(recording, landmarks, foot))
        if not stance.any() or off[stance].mean() > 1.0 - LEAST_ON_PLATES:
            continue
        v = walking_speed_m_s(recording, landmarks, foot.ground_m_s)
        heel, fore = np.asarray(foot.markers_m[:, 0]), mean_visible(np.asarray(foot.markers_m[:, 1:]))
        speeds = [smooth_velocity_m_s(track, recording.marker_rate_hz) - foot.ground_m_s for track in (heel, fore)]
        with patch.multiple(gait_events, SINKING_WEIGHTS_S=np.zeros_like(SINKING_WEIGHTS_S), SINKING_MEAN_S=0.0):
            own = contacts_of_foot(recording, landmarks, foot)
        crossings_s = [c.strike_s - STRIKE_DELAY_S for c in own if c.strike_s is not None]
        near_s = min(crossings_s, key=lambda at_s: abs(at_s - contact.start_s), default=np.inf)
        up = landing_velocities(recording.time_s, speeds[0], speeds[1], near_s).ravel() / v
        if abs(near_s - contact.strike_s) < NEAR_S and np.isfinite(up).all():
            yield Strike(source, f"{path}", contact.side, contact.strike_s, v, near_s - contact.strike_s, up)


def fit_timing(strikes: Sequence[Strike]) -> Timing:
    """Penalised regression of the differences within the recordings; strikes beyond ``MAX_SHIFT_S`` are left out."""
    used = [strike for strike in strikes if abs(strike.late_s) < MAX_SHIFT_S]
    sizes = Counter(strike.source for strike in used)
    recordings: dict[str, list[Strike]] = defaultdict(list)
    for strike in used:
        recordings[strike.recording].append(strike)
    several = [group for group in recordings.values() if len(group) > 1]
    up = np.vstack([np.array([s.up for s in group]) - np.mean([s.up for s in group], axis=0) for group in several])
    late_s = np.concatenate(
        [np.array([s.late_s for s in group]) - np.mean([s.late_s for s in group]) for group in several]
    )
    share_of = np.array([sizes[s.source] ** -0.5 for group in several for s in group])
    unit = up.std(axis=0)
    scaled, trust = up / unit, np.ones(len(up))
    weights = np.zeros(up.shape[1])
    for _ in range(6):
        w = share_of * trust
        weights = np.linalg.solve(
            scaled.T @ (scaled * w[:, None]) + PENALTY * np.eye(len(unit)), scaled.T @ (w * late_s)
        )
        trust = 1.0 / np.maximum(1.0, np.abs(late_s - scaled @ weights) / OUTLIER_S)
    weights_s = weights / unit
    mean_s = median_of_medians(used, lambda strike: float(strike.up @ weights_s))
    return Timing(weights_s, mean_s, -median_of_medians(used, Timing(weights_s, mean_s, 0.0).late_s))


def median_of_medians(strikes: Sequence[Strike], value: Callable[[Strike], float]) -> float:
    """Median over the sources of their medians."""
    values: dict[str, list[float]] = defaultdict(list)
    for strike in strikes:
        values[strike.source].append(value(strike))
    return float(np.median([np.median(one) for one in values.values()]))


def without_common(own: Sequence[tuple[str, float]]) -> list[float]:
    """Differences shifted by the other strikes of their recording, as ``walking.event_calibration`` does.

    All are taken as heel strikes (``make_event_calibration.py`` distinguishes flat landings).
    """
    own_s = MARKER_ERROR["strike"].own_s
    rest_s = []
    for k, (recording, late_s) in enumerate(own):
        others = [PlateDifference(s, own_s) for j, (name, s) in enumerate(own) if j != k and name == recording]
        common = common_difference("strike", others)
        if common is not None:
            rest_s.append(late_s - common[0])
    return rest_s


if __name__ == "__main__":
    main()
