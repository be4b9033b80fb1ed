"""Compare the measures of real walks by their markers alone with those with force; print a table.

make_markers_alone.py FOLDER...    C3D files of walks below each folder
make_markers_alone.py FOLDER... --half 0    every other person in the order of their names; --half 1 the others

Counted are steps and strides in which all force is measured, whose centre of mass is known to a few tenths of a
millimetre within a step: the difference is then nearly the error of the markers. Events and foot markers are the same
in both, so that lengths, widths and times do not differ. Copies of a recording count once.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from make_event_calibration import MOVED, PERSON
from stridelab.errors import StridelabError
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.measures.measure import Measure
from stridelab.measures.stated_errors import is_measured
from stridelab.pipelines.gait_measures.recording import MeasuredRecording, measure_recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask, RecordingSource

STEP_ENERGIES: Final = "step_e"
"""Beginning of the names of measures of single steps, of which up to 8 % may be without force."""


@dataclass(frozen=True)
class Difference:
    """A value by the markers alone minus that with force, and the deviation that is stated of the former."""

    person: str
    difference: float
    sd: float


def main() -> None:
    """Read the folders of the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--half", type=int, choices=(0, 1), help="every other person only")
    request = parser.parse_args()
    files = sorted({path for folder in request.folders for path in folder.rglob("*.c3d")})
    rows: dict[str, list[Difference]] = defaultdict(list)
    copies: set[tuple[float, ...]] = set()
    for path in files:
        if MOVED.search(str(path)):
            continue
        try:
            measured, alone = (measure_by(path, method) for method in (None, GeometryOnly.name))
        except StridelabError as error:
            sys.stderr.write(f"{path.name}: {error.message}\n")
            continue
        values = tuple(round(one.value, 6) for one in measured.measures[:6])
        if measured.motion.by_markers or values in copies:
            continue
        copies.add(values)
        name = PERSON.search(str(path))
        for measure, row in measure_differences(measured, alone, name[0] if name else str(path)):
            rows[measure].append(row)
    people = sorted({row.person for own in rows.values() for row in own})
    used = {person for k, person in enumerate(people) if request.half in (None, k % 2)}
    sys.stdout.write(table_of({name: [row for row in own if row.person in used] for name, own in rows.items()}))


def measure_by(path: Path, method: str | None) -> MeasuredRecording:
    """Measures of a file by a method of the centre of mass, by default with force."""
    request = EstimateComInput.model_validate({"recording_id": "walk", "method": method})
    task = EstimateComTask(recording=RecordingSource(file=path.name, filename=path.name), input=request)
    return measure_recording("walk", task, path.parent)


def measure_differences(
    measured: MeasuredRecording, alone: MeasuredRecording, person: str
) -> Iterator[tuple[str, Difference]]:
    """Names of measures and their differences in the steps with all force, of values that differ at all."""

    def key_of(one: Measure, steps: MeasuredRecording) -> tuple[str, str | None, float]:
        return one.name, one.side, round(steps.steps[one.step or 0].strike_s, 2)

    by_markers = {key_of(one, alone): one for one in alone.measures if one.step is not None}
    for one in measured.measures:
        other = None if one.step is None else by_markers.get(key_of(one, measured))
        if one.step is None or other is None or other.sd is None or one.name.startswith("limb_"):
            continue
        whole = one.name.startswith(STEP_ENERGIES) or is_measured(measured.motion, measured.steps[one.step], one)
        if whole and abs(other.value - one.value) > 1e-9:
            yield one.name, Difference(person, other.value - one.value, other.sd)


def table_of(rows: dict[str, list[Difference]]) -> str:
    """Markdown table; the last column is half the 95 % interval of the share, with people as units."""
    lines = ["| measure | people, n | mean | RMS | stated sd | 95 % band holds | +- |", "| --- |" + " --- |" * 6]
    for name, own in rows.items():
        late, sd = (np.array([getattr(row, field) for row in own]) for field in ("difference", "sd"))
        if len(own) == 0:
            continue
        inside: dict[str, list[bool]] = defaultdict(list)
        for row in own:
            inside[row.person].append(abs(row.difference) <= 1.96 * row.sd)
        share = np.mean(np.concatenate(list(inside.values())))
        spread = 1.96 * np.sqrt(sum(float(np.sum(np.array(k) - share)) ** 2 for k in inside.values())) / len(own)
        sizes = " | ".join(f"{k:.4f}" for k in (late.mean(), np.sqrt(np.mean(late**2)), np.sqrt(np.mean(sd**2))))
        lines.append(
            f"| `{name}` | {len(inside)}, {len(own)} | {sizes} | {100.0 * share:.0f} % | {100.0 * spread:.0f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
