"""Compare the stated errors of gait measures with the true ones on simulated walks, and write the tables of the docs.

Walks with an even seed go over a walkway with a plate below every footprint, the others over two plates; the walks over
two plates are measured a second time by their markers alone. The markers move with the skin. The simulated
feet roll without toes, so that speeds of their markers do not time their load: events by markers are the instants of
the load with errors as they are measured on people (``walking.event_calibration.MARKER_ERROR``).

make_measures_coverage.py                 400 walks, then the tables of docs/theory/gait-measures.md
make_measures_coverage.py --number 20     only so many of them
make_measures_coverage.py --first 0       seeds from 0 on (below 9000: to tune on)
make_measures_coverage.py --labs markers  walks in these laboratories only; their tables are printed, not written
make_measures_coverage.py --pelvis 0.5    skin of the pelvis that moves by half as much; give it a file with --out
make_measures_coverage.py --halves        every other walk with the factors that hold 95 % of the rest, and the reverse

Values computed before are read from --out and are not computed again.
"""

import argparse
import json
import re
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal
from unittest.mock import patch

import numpy as np

from stridelab.errors import StridelabError
from stridelab.estimation.differentiation import walk_frame
from stridelab.measures import (
    FootMotion,
    Measure,
    WalkMotion,
    angular_momentum_ranges,
    energy_exchange,
    limb_work,
    margins_of_stability,
    spatiotemporal,
)
from stridelab.measures.energy_exchange import step_energies
from stridelab.measures.rolling_wheel import rolling_wheel
from stridelab.pipelines.gait_measures.recording import measure_recording
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.foot_contact import find_feet, foot_outline
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.marker_sets import identify
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.simulation.force_plates import LabName
from stridelab.simulation.ground_truth import true_motion
from stridelab.simulation.human import marker_layout
from stridelab.simulation.human.walker import HumanWalker, Walk
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import NOISE_FREE, MeasurementNoise
from stridelab.walking import gait_events
from stridelab.walking.event_calibration import MARKER_ERROR
from stridelab.walking.gait_events import Contact
from stridelab.walking.steps import GaitStep, find_steps, footprint_direction

PAGE = Path(__file__).resolve().parent.parent / "docs" / "theory" / "gait-measures.md"
BEGIN, END = "<!-- coverage table -->", "<!-- end of the coverage table -->"
Lab = Literal["walkway", "two_plates", "markers"]
LABS: dict[Lab, str] = {
    "walkway": "A plate below every footprint",
    "two_plates": "Two plates in a row",
    "markers": "The same walks by their markers alone",
}
THRESHOLD_N = 20.0
"""Load at which a plate counts a foot as on it; the true events are defined by the same load."""

Row = tuple[str, float, float | None, float]
"""Name, value, stated standard deviation, true value."""


def main() -> None:
    """Read the command line, simulate and measure, write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(".data") / "measures-coverage.jsonl", metavar="FILE")
    parser.add_argument("--number", type=int, default=400)
    parser.add_argument("--first", type=int, default=9000, help="first seed")
    parser.add_argument("--halves", action="store_true", help="factors of either half of the walks, on the other half")
    parser.add_argument("--labs", nargs="+", choices=LABS, help="only these laboratories; tables are printed")
    parser.add_argument("--pelvis", type=float, default=1.0, help="motion of the pelvis' skin over the assumed one")
    request = parser.parse_args()
    stored: dict[tuple[int, str], list[Row]] = {}
    if request.out.is_file():
        lines = request.out.read_text(encoding="utf-8").splitlines()
        stored = {(seed, lab): [tuple(row) for row in rows] for seed, lab, rows in map(json.loads, lines)}
    seeds = range(request.first, request.first + request.number)
    request.out.parent.mkdir(parents=True, exist_ok=True)
    skin = marker_layout.SKIN_MOTION_SD_M
    skin = {**skin, "pelvis": request.pelvis * skin["pelvis"]}
    with request.out.open("a", encoding="utf-8") as out, patch.object(marker_layout, "SKIN_MOTION_SD_M", skin):
        for seed in seeds:
            for lab in labs_of(seed, request.labs):
                if (seed, lab) not in stored:
                    stored[seed, lab] = rows = compare_walk(seed, lab)
                    out.write(json.dumps([seed, lab, rows]) + "\n")
                    out.flush()
                    sys.stderr.write(f"walk {seed}, {lab}: {len(rows)} values\n")
    walks = {lab: [stored[seed, lab] for seed in seeds if lab in labs_of(seed, request.labs)] for lab in LABS}
    if request.halves:
        walks = {lab: halves_scaled(rows) for lab, rows in walks.items()}
    if request.labs:
        sys.stdout.write("\n".join(table_of(LABS[lab], walks[lab]) for lab in request.labs))
    else:
        write_tables(walks)


def labs_of(seed: int, only: Sequence[Lab] | None) -> list[Lab]:
    """The laboratories in which the walk with this seed is measured, of ``only`` if given."""
    labs: tuple[Lab, ...] = ("two_plates", "markers") if seed % 2 else ("walkway",)
    return [lab for lab in labs if only is None or lab in only]


@lru_cache(maxsize=1)
def simulate_walk(seed: int) -> tuple[Walk, MeasurementNoise]:
    """A person of random sex, stature, mass, speed; noise of cameras, plates, clock and segment table at random."""
    rng = np.random.default_rng([7, seed])
    height_m = rng.uniform(1.5, 1.95)
    walk = HumanWalker(
        height_m=height_m,
        mass_kg=rng.uniform(18.0, 32.0) * height_m**2,
        sex="female" if rng.random() < 0.5 else "male",
        speed_m_s=rng.uniform(0.6, 1.5),
        duration_s=5.0,
        seed=seed,
        steep_load=True,
    ).walk()
    noise = MeasurementNoise(
        force_n=rng.uniform(1.0, 4.0),
        moment_nm=rng.uniform(0.5, 2.0),
        marker_m=rng.uniform(0.0003, 0.0015),
        mass_model=rng.uniform(0.05, 0.3),
        latency_s=rng.choice([0.0, 0.008]),
    )
    return walk, noise


def compare_walk(seed: int, lab: Lab) -> list[Row]:
    """Measured and true values of the steps of one walk; empty if it is refused."""
    walk, noise = simulate_walk(seed)
    true_steps, truth = true_measures(seed)
    known = {(measure.name, measure.side, measure.step): measure.value for measure in truth}
    with tempfile.TemporaryDirectory() as name:
        place: LabName = "walkway" if lab == "walkway" else "two_plates"
        recording = record(walk, noise, seed, lab=place, skin_moves=noise != NOISE_FREE).recording
        write_c3d(Path(name) / "trial.c3d", replace(recording, plates=()) if lab == "markers" else recording)
        source = RecordingSource(file="trial.c3d", filename="trial.c3d")
        task = EstimateComTask(recording=source, input=EstimateComInput(recording_id="walk"))
        contacts = true_contacts(walk, walk.duration_s)
        try:
            with patch.object(gait_events, "contacts_of_foot", events_of_people(contacts, seed)):
                measured = measure_recording("walk", task, Path(name))
        except StridelabError as error:
            sys.stderr.write(f"walk {seed}: {error.message}\n")
            return []
    rows: list[Row] = []
    for measure in measured.measures:
        step = None if measure.step is None else measured.steps[measure.step]
        same = [k for k, one in enumerate(true_steps) if step and one.side == step.side and _simultaneous(one, step)]
        key = (measure.name, measure.side, same[0] if same else -1)
        if key in known:
            rows.append((measure.name, measure.value, measure.sd, known[key]))
    return rows


@lru_cache(maxsize=1)
def true_measures(seed: int) -> tuple[Sequence[GaitStep], Sequence[Measure]]:
    """Measures of the exact motion, forces, angular momentum and markers; events at ``THRESHOLD_N`` of true load."""
    walk, _ = simulate_walk(seed)
    recording = record(walk, NOISE_FREE, seed).recording
    time_s, motion = recording.time_s, true_motion(walk.body, walk.posture, recording.time_s)
    landmarks = identify(tuple(recording.markers_m), {}).landmarks
    contacts = true_contacts(walk, float(time_s[-1]))
    marked = find_feet(recording, landmarks)
    footprints = footprint_direction(recording, marked, contacts)
    frame = walk_frame(motion.velocity_m_s if footprints is None else footprints[None])
    feet = {}
    for foot in marked:
        load = walk.feet[foot.side].force_n
        force = np.column_stack([np.interp(time_s, walk.truth.time_s, load[:, axis]) for axis in range(3)])
        outline = foot_outline(recording, landmarks, foot)
        feet[foot.side] = FootMotion(foot.markers_m[:, 0] @ frame.T, outline @ frame.T, force @ frame.T)
    whole = WalkMotion(
        time_s=time_s,
        com_m=motion.com_m @ frame.T,
        velocity_m_s=motion.velocity_m_s @ frame.T,
        covariance=None,
        varying_sd_m=0.0,
        feet=feet,
        momentum_per_kg=motion.momentum_nms @ frame.T / walk.mass_kg,
        mass_kg=walk.mass_kg,
        stature_m=walk.body.proportions.height_m,
    )
    steps = find_steps(recording, landmarks, (), contacts=contacts)
    return steps, (
        *spatiotemporal(whole, steps),
        *margins_of_stability(whole, steps),
        *energy_exchange(whole, steps),
        *step_energies(whole, steps),
        *rolling_wheel(whole, steps),
        *angular_momentum_ranges(whole, steps),
        *limb_work(whole, contacts, steps),
    )


def true_contacts(walk: Walk, end_s: float) -> tuple[Contact, ...]:
    """Contacts of both feet from their true load, in the time of the recording."""
    time_s, contacts = walk.truth.time_s, []
    for side, foot in walk.feet.items():
        load = np.linalg.norm(foot.force_n, axis=1)
        for first, stop in true_runs(load > THRESHOLD_N):
            strike_s, off_s = (_crossing_s(time_s, load, k) for k in (first, stop))
            if off_s > 0.0 and strike_s < end_s:
                contacts.append(Contact(side, strike_s if strike_s > 0.0 else None, off_s if off_s < end_s else None))
    return tuple(sorted(contacts, key=lambda contact: contact.start_s))


def _crossing_s(time_s: np.ndarray, load: np.ndarray, after: int) -> float:
    """Instant at which ``load`` crosses the threshold, between the samples ``after - 1`` and ``after``."""
    if not 0 < after < len(load):
        return float(time_s[min(after, len(load) - 1)])
    share = (THRESHOLD_N - load[after - 1]) / (load[after] - load[after - 1])
    return float(time_s[after - 1] + share * (time_s[after] - time_s[after - 1]))


def events_of_people(contacts: Sequence[Contact], seed: int) -> Callable[..., list[Contact]]:
    """Replacement of ``gait_events.contacts_of_foot``: the true events with errors as measured on people."""
    rng = np.random.default_rng([11, seed])
    common = {kind: rng.normal(0.0, error.common_s) for kind, error in MARKER_ERROR.items()}
    rows = []
    for contact in contacts:
        late = {kind: common[kind] + rng.normal(0.0, error.own_s) for kind, error in MARKER_ERROR.items()}
        rows.append(
            Contact(
                contact.side,
                None if contact.strike_s is None else contact.strike_s + late["strike"],
                None if contact.lift_off_s is None else contact.lift_off_s + late["lift_off"],
            )
        )
    return lambda _recording, _landmarks, foot: [contact for contact in rows if contact.side == foot.side]


def _simultaneous(one: GaitStep, other: GaitStep) -> bool:
    return abs(one.strike_s - other.strike_s) < 0.1


def halves_scaled(walks: Sequence[Sequence[Row]]) -> list[list[Row]]:
    """The walks with deviations that hold 95 % of the values of the other half, by measure; halves are every other."""
    ratios: tuple[dict[str, list[float]], ...] = (defaultdict(list), defaultdict(list))
    for k, walk in enumerate(walks):
        for name, value, sd, truth in walk:
            if sd:
                ratios[k % 2][name].append(abs(value - truth) / (1.96 * sd))
    factors = [{name: float(np.quantile(own, 0.95)) for name, own in half.items()} for half in reversed(ratios)]
    return [
        [(name, value, sd and sd * factors[k % 2].get(name, 1.0), truth) for name, value, sd, truth in walk]
        for k, walk in enumerate(walks)
    ]


def write_tables(walks: Mapping[Lab, Sequence[Sequence[Row]]]) -> None:
    """Replace the tables of the page by those of the rows of the walks in each laboratory."""
    tables = "\n".join(table_of(LABS[lab], rows) for lab, rows in walks.items() if rows)
    text = PAGE.read_text(encoding="utf-8")
    whole = f"{BEGIN}\n{tables}\n{END}"
    PAGE.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: whole, text, flags=re.DOTALL), encoding="utf-8")


def table_of(title: str, walks: Sequence[Sequence[Row]]) -> str:
    """Markdown table of all values of ``walks`` by measure.

    The last column is half the 95 % interval of the share before it, with walks as units: errors of the steps of one
    walk have the same sign.
    """
    columns: dict[str, list[Row]] = defaultdict(list)
    held: dict[str, list[list[bool]]] = defaultdict(list)
    for walk in walks:
        own: dict[str, list[bool]] = defaultdict(list)
        for row in walk:
            columns[row[0]].append(row)
            own[row[0]].append(row[2] is not None and abs(row[1] - row[3]) <= 1.96 * row[2])
        for name, inside in own.items():
            held[name].append(inside)
    used = sum(bool(walk) for walk in walks)
    refused = "" if used == len(walks) else " (the others are refused with a reason)"
    lines = [
        "",
        f"**{title}**, {used} of {len(walks)} simulated walks{refused}:",
        "",
        "| measure | n | mean | bias | RMS error | stated sd | 95 % band holds | +- |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, rows in columns.items():
        value, truth = (np.array([row[k] for row in rows]) for k in (1, 3))
        sd = np.array([np.nan if row[2] is None else row[2] for row in rows], dtype=float)
        error = value - truth
        share = np.mean(np.concatenate(held[name]))
        spread = 1.96 * np.sqrt(sum(float(np.sum(np.array(inside) - share)) ** 2 for inside in held[name])) / len(rows)
        numbers = (truth.mean(), error.mean(), np.sqrt(np.mean(error**2)), np.sqrt(np.nanmean(sd**2)))
        cells = " | ".join(f"{number:.4f}" for number in numbers)
        lines.append(f"| `{name}` | {len(rows)} | {cells} | {100.0 * share:.0f} % | {100.0 * spread:.0f} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
