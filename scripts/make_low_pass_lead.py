"""Measure by how much a strike on low-passed plates is early, by low-passing real plates; print a Markdown table.

make_low_pass_lead.py FOLDER...    C3D files below the folders; plates that were low-passed before are left out

The strike of the force as measured (20 N) is compared with that of the same force after a zero-phase Butterworth
filter, with the dead band of 50 N that some laboratories store: as the load above 50 N shows it, and corrected by
``walking.low_passed_plates`` from the spectrum of the filtered plate alone.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stridelab.errors import StridelabError
from stridelab.recordings.plate_contacts import loaded_intervals
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Plate
from stridelab.walking.low_passed_plates import FILTERED_LOAD_N, low_pass_lead_s
from stridelab.walking.plate_events import contact_intervals

FILTERS = ((2, 8.0), (2, 10.0), (2, 12.0), (2, 15.0), (2, 20.0), (4, 10.0), (4, 12.0), (4, 15.0), (4, 20.0))
"""Order of one pass, and cut-off in hertz."""
AROUND_S = 0.3
"""Unloaded time that is kept before and after a stance."""
STANCE_S = (0.45, 0.9)
NEAR_S = 0.1


def main() -> None:
    """Read the folders of the command line and print the table."""
    stances = [stance for folder in sys.argv[1:] for stance in unfiltered_stances(Path(folder))]
    lines = [
        "| order of a pass, cut-off | stances | load above 50 N | corrected |",
        "| --- | --- | --- | --- |",
    ]
    for order, cut_hz in FILTERS:
        leads = np.array([row for row in (leads_ms(*stance, order, cut_hz) for stance in stances) if row is not None])
        cells = [f"{np.median(column):.0f} ms, sd {column.std():.0f}" for column in leads.T]
        lines.append(f"| {order}, {cut_hz:.0f} Hz | {len(leads)} of {len(stances)} | {' | '.join(cells)} |")
    sys.stdout.write("\n".join([*lines, ""]))


def unfiltered_stances(folder: Path) -> Iterator[tuple[Plate, float]]:
    """Plates cut to one stance each, with their rate; stances that occur in several files count once."""
    known_stances = set()
    for path in sorted(folder.rglob("*.c3d")):
        try:
            recording = read_recording(path)
        except StridelabError as error:
            sys.stderr.write(f"{path.name}: {error.message}\n")
            continue
        rate_hz = recording.force_rate_hz
        for plate in recording.plates:
            if not plate.use or low_pass_lead_s(plate, rate_hz) is not None:
                continue
            for start_s, end_s in loaded_intervals(plate, rate_hz):
                i, j = (round(at_s * rate_hz) for at_s in (start_s, end_s))
                key = round(float(plate.force_n[i : j + 1].sum()), 3)
                if (
                    STANCE_S[0] < end_s - start_s < STANCE_S[1]
                    and i > 0
                    and j < len(plate.force_n) - 1
                    and key not in known_stances
                ):
                    known_stances.add(key)
                    margin = np.zeros((round(AROUND_S * rate_hz), 3))
                    alone = np.concatenate([margin, plate.force_n[i : j + 1], margin])
                    yield replace(plate, force_n=alone, moment_nm=np.zeros_like(alone)), rate_hz


def leads_ms(plate: Plate, rate_hz: float, order: int, cut_hz: float) -> tuple[float, float] | None:
    """Strike of the filtered force minus that of the measured one, as extrapolated and corrected."""
    sections = butter(order, cut_hz, fs=rate_hz, output="sos")
    smooth = sosfiltfilt(sections, plate.force_n, axis=0)
    smooth[smooth[:, 2] < FILTERED_LOAD_N] = 0.0
    filtered = replace(plate, force_n=smooth)
    lead_s = low_pass_lead_s(filtered, rate_hz)
    true, late = (contact_intervals(one, rate_hz) for one in (plate, filtered))
    if lead_s is None or len(true) != 1 or len(late) != 1 or true[0][0] is None or late[0][0] is None:
        return None
    off_s = late[0][0] - true[0][0]
    return None if abs(off_s) > NEAR_S else (1e3 * (off_s - lead_s), 1e3 * off_s)


if __name__ == "__main__":
    main()
