"""Estimate every recording below some folders and write a page of outcomes; see scripts/strangers.

Without folders the recordings that ``scripts/strangers.tsv`` lists are fetched from their repositories and surveyed,
and those whose outcome differs from the list are named. Otherwise each folder is one source: the recordings of one
laboratory or repository.

Every recording is read and estimated with default options in a process of its own, with limits on time and memory. A
TRC file is zipped with the force file that belongs to it: one of the same name, or of the same name and a word such as
``_grf``; a TSV file of Qualisys with those of its plates (``_f_1.tsv``), joint angles with their OpenSim model and
forces. A recording that is refused without a static trial, or for labels of no known set, is estimated with the one
beside it whose name is the most like its own; where that fails, too, the first refusal is its outcome.

The rows (one JSON object a line) tell for each recording its outcome: ``estimate``, or the code of the error. A survey
that was interrupted goes on where it stopped; delete the rows to start anew.
"""

import argparse
import collections
import hashlib
import importlib
import json
import math
import re
import resource
import statistics
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import numpy as np

import strangers_list
import stridelab as sl
from strangers_files import Trial, listed_trials, trials_below
from stridelab.errors import StridelabError
from stridelab.estimation.random_effects import pool_measurements
from stridelab.machine.parallel import map_isolated
from stridelab.pipelines.session_values import MASS_REPEATABILITY_SHARE

PRELOAD: Final = ("stridelab.library.recordings", "stridelab.pipelines.estimate_com")
TIMEOUT_S: Final = 90.0
MEMORY_BYTES: Final = 4 << 30
TOLERATED_MM: Final = 50.0
"""A result farther from the geometry must carry an error remark."""
NO_FORCE: Final = frozenset({"no-plates", "no-measured-window", "plates-unloaded", "window-too-short", "mass-unknown"})
"""Refusals of a fused estimate after which the geometry alone is tried."""
PROCESS_OUTCOMES: Final = {"computation-timed-out": "timeout", "computation-crashed": "crash"}
OUTCOMES: Final = (*strangers_list.ESTIMATES, "contradicted")
"""Outcomes with a result."""
STATIC_NEEDED: Final = ("knee-markers-missing", "pelvis-markers-missing", "unknown-marker-set")


INTRODUCTION: Final = """\
Written by `scripts/strangers`: public recordings, read and estimated with default options. They are not part of the
project; `scripts/strangers.tsv` lists their repositories, commits, paths and outcomes, and the script fails where an
outcome is another one. Evidence: measured on people; no truth is known for them, only whether a result contradicts
itself.

A content that occurs in several repositories counts once; a trial that a laboratory published in two formats, or
processed twice, counts twice (PhilD001/biomechZoo has the trials of mcgillmotionlab/biomechzoo). Of the wheelchair
recordings of SamuelHybois/ibhgc_OpenSim, which mark no leg, every tenth is listed.

*Tuned*: a marker set, a label or a rule was made with files of this source, or with copies of them. *Held-out*: none
was. *Fused*: markers and force plates together. *Geometry only*: no plate has usable force. *Contradicted*: the result
has the error remark `contradicted` and does not count as an estimate.

`trial*_out.c3d` of CGA_Rehazenter_Toolbox state 33 kg and 0.95 m for legs of a person of 1.9 m, and the plates carry
95 kg: the subject's data of such a file are not used (`subject-of-another-body`). The runs of
BMC-RIC-running-biomechanics that are refused with `pelvis-markers-missing` mark the pelvis by clusters alone.

The tables are of one state of the program; the outcomes of the list are those of the present one as far as files were
at hand: 503 of 1583 recordings, in 25 repositories, were surveyed again with it, and none differed. 867 recordings take
2:17 minutes on two quick cores with nothing beside them. Ten jumps whose masses had another standard deviation
afterwards do not differ either.
Of the 603 with plates outside one teaching laboratory (javrx/biomec and those named with it
below) none has its plates turned; the check `body_axis` fails for two of all results: a person on hands and feet
(`trial0010_mountain_climber.tsv`) and a rotated file (`temp_trc_file_rotated.trc`), both contradicted by other checks.
Sessions are counted by folder, so that copies of a trial in two folders or formats count in both. The causes of the
masses that differ are in [Sessions](theory/sessions.md).

Refused C3D files: ezc3d reads none of those with `c3d-parameters-broken`. Optotrak.c3d (`truncated-file`) states 1149
frames in its header and holds 29. The files with `all-missing` hold zeros or a residual of -1 at every point;
those with `no-markers` hold analog channels, angles, rotations or unnamed points.

Causes of contradicted results that were looked into, none of which is in the program:

- `uphill_walking_calibrated.trc`: the file has the axes of an inclined treadmill; the mean force leans by 16.7 degrees
  (`force_tilt`).
- `1min_emg_static.c3d`: a person stands with the centre of pressure at the ankles and the markers' centre of mass 7 cm
  in front of them, which nobody can; in another standing trial of the laboratory they are 2 cm apart. The plates, never
  unloaded, have another zero or another place there.
- `S1_FlywheelSquat.c3d`: the rope of a flywheel pulls as much as the person weighs.
- `right_hip.c3d` of biobuddy: a person stands on one plate that is never unloaded and measures 26 N sideways for four
  seconds, which standing does not need: a hand on a support, or the zero of the plate.
- `IK_gait.mot` of MuscleRedundancySolver: its model weighs 17 % more than the person on the plates.
- `Leg39_swing_IK_results.sto`: a model of one leg.
- `Res16bits.c3d`: the centre of pressure of one of six plates lies 0.2 m from the feet.
- `temp_trc_file_rotated.trc`: hips and neck are 2.2 m apart (`body_proportions`).
- Recordings without markers on the trunk: it leans more than the upright one that is assumed (50 mm are 15 degrees; two
  runs of pfjrf-methods at 52 mm). `QCMAS.dynamic.c3d` marks C7, which its set did not know; now the result is fused.

The readers' own test suites (ezc3d, py-c3d, BTK, c3dio, pyomeca, kineticstoolkit; 161 different contents) give 138
recordings and 23 named refusals. Of 119 of them, damaged anew (cut off, bytes of the header or of the parameters
replaced), 39 are read and 80 refused by name. None crashes; the largest process has 180 MiB, the slowest takes 2.3 s.
"""


def uploaded(trial: Trial, folder: Path) -> Path:
    """The file as a user would upload it: itself, or a zip of it and the files that belong to it."""
    if not trial.others:
        return trial.path
    archive = folder / f"{trial.path.stem}.zip"
    with zipfile.ZipFile(archive, "w") as zip_file:
        for path in (trial.path, *trial.others):
            zip_file.write(path, path.name)
    return archive


def estimated(loaded: Any) -> tuple[Any, str | None]:
    """The estimate of a read recording; without usable force the geometry alone, and why the fusion was refused."""
    try:
        return sl.estimate_com(loaded), None
    except StridelabError as refusal:
        if refusal.code not in NO_FORCE:
            raise
        return sl.estimate_com(loaded, method="geometry"), refusal.code


def mass_columns(trial: Any) -> dict[str, Any]:
    """Mass and standard deviation that the plates show in a trial, and a digest of its plates, rates and person."""
    recording, mass = trial.recording, trial.force_mass
    plates = [(plate.type, np.round(plate.corners_m * (plate.type > 0), 3).tolist()) for plate in recording.plates]
    person = (recording.subject.height_m, recording.subject.mass_kg)
    equipment = repr((plates, recording.marker_rate_hz, recording.force_rate_hz, person))
    return {
        "weighed_kg": None if mass is None else [mass.mass_kg, mass.sd_kg],
        "equipment": hashlib.sha256(equipment.encode()).hexdigest()[:8],
    }


def examine_recording(trial: Trial) -> dict[str, Any]:
    """In a process of its own: estimate one recording. Returns its row."""
    began_s = time.monotonic()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    warnings.simplefilter("error")
    row: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            loaded = sl.read(uploaded(trial, Path(folder)))
            recording = loaded.recording
            row |= {"frames": recording.n_frames, "markers": len(recording.markers_m), "plates": len(recording.plates)}
            row["labels"] = hashlib.sha256("\n".join(sorted(map(str.lower, recording.markers_m))).encode()).hexdigest()[
                :8
            ]
            try:
                com, row["refused_fusion"] = estimated(loaded)
            except StridelabError as refusal:
                if refusal.code not in STATIC_NEEDED or trial.static is None:
                    raise
                row["static"] = trial.static.name
                try:
                    com, row["refused_fusion"] = estimated(sl.read(loaded.path, static=trial.static))
                except StridelabError:
                    raise refusal from None  # the static trial is a guess, and did not help
            geometry = com.result.prepared.geometric
            nearest = np.searchsorted(geometry.time_s, com.time_s - 1e-6).clip(max=len(geometry.time_s) - 1)
            difference_m = com.com_m - geometry.com_m[nearest]
            row |= {
                "outcome": "estimate",
                "method": com.summary.method,
                "window_s": list(com.summary.window_s),
                "mass_kg": com.summary.mass_kg,
                "difference_mm": round(float(np.nanmax(np.abs(difference_m)) * 1e3), 1),
                "verdict": com.summary.quality.verdict if com.summary.quality else None,
                "checks": {check.name: check.value for check in com.summary.quality.checks if not check.passed}
                if com.summary.quality
                else {},
                "innovations": com.summary.diagnostics.get("normalised_innovations"),
                "remarks": [remark.code for remark in com.summary.warnings],
                **mass_columns(com.result.prepared.trial),
            }
        except StridelabError as refusal:
            row |= {"outcome": refusal.code, "message": str(refusal)[:300]}
        except BaseException as failure:  # noqa: BLE001 - a crash is an outcome to report
            row |= {"outcome": "crash", "message": f"{type(failure).__name__}: {failure}"[:300]}
    row["took_s"] = round(time.monotonic() - began_s, 2)
    row["peak_mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return row


def examine_recordings(trials: Sequence[Trial]) -> Iterator[dict[str, Any]]:
    """The rows of recordings as they finish; a cluster (``STRIDELAB_DASK_URL``) must see the files."""
    results = map_isolated(examine_recording, trials, preload=PRELOAD, timeout_s=TIMEOUT_S)
    with closing(results):
        for index, result in results:
            trial = trials[index]
            digest = hashlib.sha256(trial.path.read_bytes()).hexdigest()[:16]
            row = {"source": trial.source, "path": trial.name, "sha256": digest, "took_s": TIMEOUT_S}
            if not isinstance(result, StridelabError):
                yield row | result
            else:
                yield row | {"outcome": PROCESS_OUTCOMES[result.code], "message": str(result)}


def page(rows: Sequence[dict[str, Any]], entries: Sequence[strangers_list.Entry]) -> str:
    """Outcomes by source, and the refusals with a sentence of one recording each."""
    lines = [
        "# Recordings of other laboratories",
        "",
        INTRODUCTION,
        *_sources(rows, {entry.repository: entry.use for entry in entries}),
        "",
        *_shares(rows, entries),
        "",
        "| refused with | recordings | sources | for example |",
        "| --- | --- | --- | --- |",
    ]
    refused = collections.defaultdict(list)
    for row in rows:
        if row["outcome"] != "estimate":
            refused[row["outcome"]].append(row)
    for code, some in sorted(refused.items(), key=lambda item: -len(item[1])):
        message = re.sub(r"\s+", " ", some[0].get("message", "")).replace("|", "\\|")[:160]
        lines.append(f"| `{code}` | {len(some)} | {len({row['source'] for row in some})} | {message} |")
    took_s = [row["took_s"] for row in rows]
    times = f"median {statistics.median(took_s):.1f} s, longest {max(took_s):.1f} s"
    absent = len({entry.key for entry in entries} - {(row["source"], row["path"]) for row in rows})
    if absent:
        lines += ["", f"Of {len(entries)} listed recordings, {absent} could not be fetched for this survey."]
    lines += ["", f"Time per recording, beside other work of the machine: {times}."]
    lines.append(f"Largest process: {max(row.get('peak_mib', 0) for row in rows)} MiB.")
    lines += ["", *first_sight([entry for entry in entries if entry.first])]
    return "\n".join(lines) + "\n"


def first_sight(entries: Sequence[strangers_list.Entry]) -> list[str]:
    """The table of first outcomes by source and commit, and the codes of the refusals."""
    if not entries:
        return []
    head = "| source | commit | recordings | fused | geometry only | contradicted | refused with |"
    lines = [strangers_list.FIRST_SIGHT, head, "| --- " * 7 + "|"]
    for source, commit in sorted({(entry.repository, entry.commit) for entry in entries}):
        firsts = [entry.first for entry in entries if (entry.repository, entry.commit) == (source, commit)]
        refused = collections.Counter(first for first in firsts if first not in OUTCOMES)
        codes = ", ".join(f"`{code}` {n}" for code, n in sorted(refused.items()))
        cells = [source, commit[:12], len(firsts), *(firsts.count(outcome) for outcome in OUTCOMES), codes]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    firsts = [entry.first for entry in entries]
    cells = ["all", "", len(firsts), *(firsts.count(outcome) for outcome in OUTCOMES)]
    return [*lines, "| " + " | ".join(map(str, [*cells, sum(first not in OUTCOMES for first in firsts)])) + " |"]


def _sources(rows: Sequence[dict[str, Any]], use: dict[str, str]) -> list[str]:
    """The table of outcomes by source."""
    lines = [
        "| source | use | recordings | fused | geometry only | contradicted | refused |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    sources = sorted({row["source"] for row in rows}, key=lambda source: (use.get(source, ""), source.lower()))
    parts = [(source, use.get(source, ""), {source}) for source in sources]
    parts += [("all", total, {s for s in sources if use.get(s) == total}) for total in sorted(set(use.values()))]
    for name, used, some_sources in [*parts, ("all", "", set(sources))]:
        some = [row for row in rows if row["source"] in some_sources]
        count = collections.Counter(
            code if code in OUTCOMES else "refused" for code in map(strangers_list.outcome_of, some)
        )
        cells = [name, used, len(some), *(count[key] for key in (*OUTCOMES, "refused"))]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def _shares(rows: Sequence[dict[str, Any]], entries: Sequence[strangers_list.Entry]) -> list[str]:
    """Estimates among whole bodies with forces and among runs; results far from the geometry."""
    outcomes = {(row["source"], row["path"]): strangers_list.outcome_of(row) for row in rows}
    lines = []
    for name, chosen in (
        ("Pelvis, legs and trunk are marked, with plates", [e for e in entries if e.marked == "body" and e.plates]),
        ("Pelvis and legs alone are marked, with plates", [e for e in entries if e.marked == "legs" and e.plates]),
        ("Runs and sprints", [e for e in entries if e.is_running]),
        (
            "Runs and sprints that mark the knees, in the trial or in a static trial beside it",
            [e for e in entries if e.is_running and e.marked in ("body", "legs")],
        ),
    ):
        for use in ("tuned", "held-out"):
            some = [outcomes[entry.key] for entry in chosen if entry.use == use and entry.key in outcomes]
            good = sum(outcome in strangers_list.ESTIMATES for outcome in some)
            lines.append(f"- {name}, sources {use}: {good} of {len(some)} give an estimate.")
    wrong = [row for row in rows if row["outcome"] == "estimate" and row["difference_mm"] > TOLERATED_MM]
    silent = [row for row in wrong if row["verdict"] != "contradicted"]
    far = f"{len(wrong)}; of these without an error remark: {len(silent)}"
    return [*lines, f"- Results more than {TOLERATED_MM:.0f} mm from the geometry: {far}.", *_session_lines(rows)]


def _session_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """How far the masses of single trials are from those of their sessions."""
    sessions = strangers_list.sessions_of(rows)
    near = unsure = 0
    for session in sessions:
        masses, sds = zip(*(row["weighed_kg"] for row in session), strict=True)
        own = [math.hypot(sd, MASS_REPEATABILITY_SHARE * mass) for mass, sd in zip(masses, sds, strict=True)]
        mean = pool_measurements(masses, own, scaled=True).mean
        far = [i for i, mass in enumerate(masses) if abs(mass / mean - 1.0) > strangers_list.SESSION_SHARE]
        near += not far
        unsure += bool(far) and all(abs(masses[i] - mean) <= 2.0 * sds[i] for i in far)
    if not sessions:
        return []
    share = f"{strangers_list.SESSION_SHARE:.1%}"
    counted = f"{len(sessions)}; in {near} no trial weighs more than {share} beside all of them"
    further = f"in {unsure} more none by more than two of its deviations"
    return [f"- Sessions (trials of one folder, person, plates and rates): {counted}, {further}."]


def main() -> None:
    """Survey the recordings of the list, or the folders of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="folders to survey instead of the list")
    parser.add_argument("--into", type=Path, default=Path("strangers"), help="fetch the recordings of the list to here")
    parser.add_argument("--mirrors", type=Path, help="folder of Git mirrors named owner+name; default: GitHub")
    parser.add_argument("--rows", type=Path, default=Path("strangers.jsonl"), help="rows, one JSON object a line")
    parser.add_argument("--page", type=Path, help="write the page of outcomes here; default: print it")
    parser.add_argument("--renew", action="store_true", help="write the outcomes to the list")
    arguments = parser.parse_args()
    for module in PRELOAD:
        importlib.import_module(module)  # once, for all processes that are forked from this one
    entries = [] if arguments.folders else strangers_list.read_list()
    strangers_list.fetch(entries, arguments.into, arguments.mirrors)
    trials = [trial for folder in arguments.folders for trial in trials_below(folder)]
    trials += listed_trials(entries, arguments.into)
    rows = [json.loads(line) for line in arguments.rows.read_text().splitlines()] if arguments.rows.exists() else []
    known = {(row["source"], row["path"]) for row in rows}
    work = [trial for trial in trials if (trial.source, trial.name) not in known]
    with arguments.rows.open("a", encoding="utf-8") as out:
        for n, row in enumerate(examine_recordings(work), 1):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            sys.stderr.write(f"\r{n} of {len(work)} ")
    text = page(rows, entries)
    if arguments.page:
        arguments.page.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
    if arguments.renew:
        strangers_list.write_list(strangers_list.renewed(entries, rows))
    elif different := strangers_list.differences(entries, rows):
        sys.exit("\n".join(different))


if __name__ == "__main__":
    main()
