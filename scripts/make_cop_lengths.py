"""Compare lengths and widths of steps by the heels with those by the centres of pressure; print a Markdown table.

make_cop_lengths.py NAME=FOLDER...    C3D files of walks below each folder, a laboratory each

A step between two stances, each with the whole foot on a plate of its own, is measured a second time by the plates
alone: as the distance of the mean centres of pressure of both stances over the same phases. The phases count from the
strike to the lift-off on the plate, so that neither the markers nor their clock enter. What remains is the asymmetry of
the two feet: how far a centre of pressure is ahead of its heel, and beside it. A person is the folder or the
digits of the file's name, as in ``make_event_calibration.py``; sampling errors count people.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from make_event_calibration import LEAST_ON_PLATES, MOVED, PERSON
from stridelab.conventions import Vector3
from stridelab.errors import StridelabError
from stridelab.pipelines.gait_measures.recording import MeasuredRecording, measure_recording
from stridelab.recordings.foot_contact import find_feet, foot_outline
from stridelab.recordings.plate_contacts import centre_of_pressure_m, loaded_intervals, outline_off_plates
from stridelab.recordings.recording import Recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.walking.gait_events import Contact
from stridelab.walking.steps import footprint_direction

PHASES: Final = {"5 to 15 %": (0.05, 0.15), "15 to 45 %": (0.15, 0.45), "10 to 90 %": (0.1, 0.9)}
"""Parts of a stance over which a centre of pressure is averaged: below the heel, the flat foot, nearly all of it."""
MOST_ACROSS_M: Final = 0.1
"""Largest change of a width by centres of pressure between the phases; a larger one is of a plate and not of feet."""
NEAR_S: Final = 0.04
"""Largest difference of the load on a plate from the contact that it is taken to be, at both ends."""
QUANTITIES: Final = ("length", "length, landing heel at its strike", "width")


@dataclass(frozen=True)
class ComparedStep:
    """Lengths and widths of one step in metres: by the heels, and by the centres of pressure over ``PHASES``."""

    laboratory: str
    person: str
    by_heels_m: tuple[float, float, float]
    """In the order of ``QUANTITIES``."""
    by_cop_m: dict[str, tuple[float, float]]
    """Ahead and outwards, by the name of the phases."""


def main() -> None:
    """Read the folders of the command line and print the table."""
    compared: list[ComparedStep] = []
    for request in sys.argv[1:]:
        laboratory, folder = request.split("=", 1)
        for path in sorted(Path(folder).rglob("*.c3d")):
            if MOVED.search(path.name):
                continue
            try:
                compared += compare_steps(laboratory, path)
            except StridelabError as error:
                sys.stderr.write(f"{path.name}: {error.message}\n")
    sys.stdout.write("\n".join([*table_lines(compared), ""]))


def compare_steps(laboratory: str, path: Path) -> Iterator[ComparedStep]:
    """The steps of a recording whose two stances stand on plates of their own."""
    source = RecordingSource(file=path.name, filename=path.name)
    request = EstimateComTask(recording=source, input=EstimateComInput(recording_id="walk"))
    measured = measure_recording("walk", request, path.parent)
    recording, landmarks = measured.prepared.trial.recording, measured.prepared.trial.match.landmarks
    feet = {foot.side: foot for foot in find_feet(recording, landmarks)}
    ahead = footprint_direction(recording, list(feet.values()), measured.contacts)
    if ahead is None or len(feet) < len(("left", "right")):
        return
    left = np.cross([0.0, 0.0, 1.0], ahead)
    centres = {contact: centres_m(measured, contact) for contact in measured.contacts}
    person = PERSON.search(str(path))
    widths = {m.step: m.value for m in measured.measures if m.name == "step_width"}
    for number, step in enumerate(measured.steps):
        landing, standing = (
            next((c for c in measured.contacts if c.side == side and getattr(c, event) == at_s), None)
            for side, event, at_s in (
                (step.side, "strike_s", step.strike_s),
                ("left" if step.side == "right" else "right", "lift_off_s", step.next_lift_off_s),
            )
        )
        if landing is None or standing is None or step.length_m is None or number not in widths:
            continue
        of_landing, of_standing = centres[landing], centres[standing]
        if not of_landing or not of_standing:
            continue
        outwards = left if step.side == "left" else -left
        at_strike_m = heel_at_strike_m(recording, feet[step.side].markers_m[:, 0] @ ahead, step.strike_s)
        at_flat_m = heel_at_strike_m(recording, feet[step.side].markers_m[:, 0] @ ahead, step.next_lift_off_s)
        by_cop_m = {name: project_m(of_landing[name] - of_standing[name], ahead, outwards) for name in PHASES}
        if np.ptp([across_m for _, across_m in by_cop_m.values()]) > MOST_ACROSS_M:
            sys.stderr.write(f"{path.name}: left out, a centre of pressure leaves its foot sideways\n")
            continue
        by_heels_m = (step.length_m, step.length_m + at_strike_m - at_flat_m, widths[number])
        yield ComparedStep(laboratory, person.group() if person else path.stem, by_heels_m, by_cop_m)


def project_m(step_m: Vector3, ahead: Vector3, outwards: Vector3) -> tuple[float, float]:
    """Parts of a step along the walk and outwards from the standing foot."""
    return float(step_m @ ahead), float(step_m @ outwards)


def heel_at_strike_m(recording: Recording, heel_ahead_m: np.ndarray, at_s: float) -> float:
    """Position of a heel along the walk at an instant."""
    return float(np.interp(at_s, recording.time_s, heel_ahead_m))


def centres_m(measured: MeasuredRecording, contact: Contact) -> dict[str, Vector3]:
    """Mean centre of pressure of a stance over ``PHASES``; empty if it has no plate of its own below the whole foot."""
    recording, landmarks = measured.prepared.trial.recording, measured.prepared.trial.match.landmarks
    if contact.strike_source != "plates" or contact.lift_off_source != "plates":
        return {}
    foot = next(one for one in find_feet(recording, landmarks) if one.side == contact.side)
    plates = [plate for plate in recording.plates if plate.use]
    stance = (recording.time_s > contact.start_s) & (recording.time_s < contact.end_s)
    off = outline_off_plates(recording, plates, foot, foot_outline(recording, landmarks, foot))
    if not stance.any() or off[stance].mean() > 1.0 - LEAST_ON_PLATES:
        return {}
    latency_s = measured.prepared.latency.applied_s
    loads = []
    for plate in plates:
        for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
            ends_s = (start_s - latency_s - contact.start_s, end_s - latency_s - contact.end_s)
            if max(map(abs, ends_s)) < NEAR_S:
                loads.append((plate, start_s, end_s))
    if len(loads) != 1:
        return {}
    plate, start_s, end_s = loads[0]
    centre = centre_of_pressure_m(plate)
    time_s = np.arange(len(centre)) / recording.force_rate_hz
    share = (time_s - start_s) / (end_s - start_s)
    means = {name: np.nanmean(centre[(share > a) & (share < b)], axis=0) for name, (a, b) in PHASES.items()}
    return means if all(np.isfinite(mean).all() for mean in means.values()) else {}


def table_lines(compared: Sequence[ComparedStep]) -> list[str]:
    """Differences of the heels from the centres of pressure by laboratory, quantity and phases."""
    lines = [
        "| laboratory | people, steps | quantity | phases | bias, mm | +- | sd, mm | sd within a person, mm | r |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    laboratories = list(dict.fromkeys(step.laboratory for step in compared))
    for laboratory in [*laboratories, "all"]:
        own = [step for step in compared if laboratory in {step.laboratory, "all"}]
        people = [step.person for step in own]
        for k, quantity in enumerate(QUANTITIES):
            for phases in PHASES:
                heels = np.array([step.by_heels_m[k] for step in own])
                cop = np.array([step.by_cop_m[phases][int(quantity == "width")] for step in own])
                numbers = " | ".join(summary_cells(heels, cop, people))
                lines.append(f"| {laboratory} | {len(set(people))}, {len(own)} | {quantity} | {phases} | {numbers} |")
    return lines


def summary_cells(heels_m: np.ndarray, cop_m: np.ndarray, people: Sequence[str]) -> list[str]:
    """Bias with its 95 % interval over people, deviation of all steps and about the mean of a person, correlation."""
    by_person: dict[str, list[float]] = defaultdict(list)
    difference_mm = 1e3 * (heels_m - cop_m)
    for person, value in zip(people, difference_mm, strict=True):
        by_person[person].append(float(value))
    bias = float(difference_mm.mean())
    sums = [sum(values) - bias * len(values) for values in by_person.values()]
    half = 1.96 * float(np.sqrt(np.sum(np.square(sums)))) / len(difference_mm)
    rest = [value - float(np.mean(values)) for values in by_person.values() for value in values if len(values) > 1]
    free = len(rest) - sum(len(values) > 1 for values in by_person.values())
    within = f"{np.sqrt(np.sum(np.square(rest)) / free):.1f}" if free > 0 else "-"
    r = float(np.corrcoef(heels_m, cop_m)[0, 1])
    return [f"{bias:.1f}", f"{half:.1f}", f"{difference_mm.std(ddof=1):.1f}", within, f"{r:.3f}"]


if __name__ == "__main__":
    main()
