"""From many recordings to the scores of all estimators, by what none of them was given.

    recordings -> inputs of the estimators -> scores per recording and method -> means over people

Recordings that cannot be scored are listed and left out.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Int

from stridelab.errors import Fault, NotEstimable, StridelabError
from stridelab.estimation.evaluation.force_path import PlateErrors
from stridelab.estimation.evaluation.plate_references import PlateEvidence, plate_evidence, plate_references
from stridelab.estimation.evaluation.unseen_scores import (
    FEWEST_PEOPLE,
    SCORES,
    ScoreColumn,
    ScoredInputs,
    ScoreRow,
    mean_scores,
    movement_of,
    score_estimator,
)
from stridelab.estimation.quality.assessment import CONTRADICTED
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs
from stridelab.pipelines.compare_estimators import floor_height_m
from stridelab.pipelines.estimate_com import (
    assess_estimate,
    build_estimator,
    estimate_with_fallback,
    quality_schema,
    worst_quality,
)
from stridelab.pipelines.progress import ItemMap, Json, ProgressCallback
from stridelab.schemas import base
from stridelab.schemas.comparison import (
    BenchColumn,
    BenchMember,
    BenchScore,
    ComBenchSummary,
    ComBenchTask,
    MassAgreement,
    MethodRefusal,
)
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.methods import METHODS
from stridelab.schemas.population import LeftOut
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.tasks import EstimateComTask

REFERENCES: Final = ("shimba1984", "zatsiorsky1998", "efron2004", "efron1987")
_FORCE_MASSES: Final = ("standing", "impulse", "whole_steps", "static", "session")


@dataclass(frozen=True)
class ComBenchResult:
    """Scores of every recording, with its file name, and the summary."""

    rows: tuple[tuple[str, ScoreRow], ...]
    summary: ComBenchSummary


def bench_estimators(
    task: ComBenchTask, folder: Path, map_recordings: ItemMap, progress: ProgressCallback
) -> ComBenchResult:
    """Score all estimators on every recording of ``task``, by ``map_recordings``, and take means over people.

    Raises ``NotEstimable`` (``nothing-scored``) if no recording can be scored.
    """
    progress(0.0, f"scoring {len(task.members)} recordings")
    items = [{"task": one.task.model_dump(mode="json"), "folder": str(folder / one.folder)} for one in task.members]
    answers: dict[int, Json | StridelabError] = {}
    for count, (index, answer) in enumerate(map_recordings(score_recording, items), start=1):
        answers[index] = answer
        progress(0.95 * count / len(items), f"{count} of {len(items)} recordings scored")
    scored = {}
    left_out = []
    for index, member in enumerate(task.members):
        answer = answers[index]
        reason = _reason_to_leave_out(answer)
        if reason is None and not isinstance(answer, StridelabError):
            scored[index] = answer
        else:
            code, message = reason or ("", "")
            filename = member.task.recording.filename
            left_out.append(LeftOut(recording_id=member.recording_id, filename=filename, code=code, message=message))
    if not scored:
        faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in left_out]
        raise NotEstimable("nothing-scored", "In none of the recordings could the estimators be scored.", faults)
    rows = tuple(
        (task.members[index].task.recording.filename, _score_row(task.members[index], answer))
        for index, answer in scored.items()
    )
    return ComBenchResult(rows, _bench_summary(task, scored, left_out, rows))


def score_recording(item: Json) -> Json:
    """Score all estimators on one recording, with JSON on both sides; runs in a separate process.

    Raises as ``prepare_com_inputs`` does.
    """
    task, folder = EstimateComTask.model_validate(item["task"]), Path(item["folder"])
    prepared = prepare_com_inputs(task, folder, lambda _fraction, _message: None, needs_force=True)
    request = EstimateComInput(recording_id=task.input.recording_id)
    quality = quality_schema(assess_estimate(prepared, estimate_with_fallback(None, request, prepared)))
    inputs = scored_inputs(prepared)
    scores: dict[str, dict[str, float]] = {}
    refused = {}
    for method in METHODS:
        try:
            of_method = score_estimator(build_estimator(method, request), inputs)
        except NotEstimable as error:
            refused[method] = {"code": error.code, "message": error.message}
            continue
        for name, value in of_method.items():
            if np.isfinite(value):
                scores.setdefault(name, {})[method] = value
    masses = {known.source: known.mass_kg for known in prepared.mass.compared}
    measured = next((masses[source] for source in _FORCE_MASSES if source in masses), None)
    evidence = _evidence_of_plates(prepared)
    return {
        "movement": movement_of(inputs),
        "scores": scores,
        "refused": refused,
        "quality": quality.model_dump(mode="json"),
        "masses_kg": [prepared.mass.stated_kg, measured],
        "plates": evidence,
    }


def scored_inputs(prepared: ComInputs) -> ScoredInputs:
    """Inputs of the scores: plates are read at the instants of the corrected wrench."""
    recording = prepared.trial.recording
    return ScoredInputs(
        geometric=prepared.geometric,
        wrench=prepared.wrench,
        mass_kg=prepared.mass.mass_kg,
        plate_loaded=np.array([plate.loaded[_force_samples(prepared)] for plate in recording.plates if plate.use]),
        clock_s=prepared.latency.sd_s or PlateErrors().clock_s,
        floor_height_m=floor_height_m(recording),
    )


def _force_samples(prepared: ComInputs) -> Int[np.ndarray, "n"]:
    """Samples of the plates at the instants of the corrected wrench."""
    recording = prepared.trial.recording
    at = np.rint((prepared.wrench.time_s + prepared.latency.applied_s) * recording.force_rate_hz).astype(int)
    return np.asarray(np.clip(at, 0, len(recording.plates[0].force_n) - 1))


def _evidence_of_plates(prepared: ComInputs) -> Json | None:
    """Evidence for where the plates' moments refer to, with their indices and centres; None if the walk has none."""
    used = [plate for plate in prepared.trial.recording.plates if plate.use]
    forces_n = np.array([plate.force_n[_force_samples(prepared)] for plate in used])
    found = plate_evidence(prepared.geometric, prepared.wrench, forces_n, prepared.mass.mass_kg)
    if found is None:
        return None
    centres_cm = np.rint(100.0 * np.array([plate.corners_m.mean(axis=0) for plate in used])).astype(int)
    laboratory = [[plate.index, *centre] for plate, centre in zip(used, centres_cm.tolist(), strict=True)]
    return {"laboratory": laboratory, "gram": found.gram.tolist(), "right": found.right.tolist()}


def _reason_to_leave_out(answer: Json | StridelabError) -> tuple[str, str] | None:
    if isinstance(answer, StridelabError):
        return answer.code, answer.message
    quality = Quality.model_validate(answer["quality"])
    if quality.verdict == CONTRADICTED:
        wrong = " ".join(check.message for check in quality.checks if not check.passed)
        return CONTRADICTED, f"The sensors of this recording contradict each other. {wrong}"
    if not answer["scores"]:
        first = next(iter(answer["refused"].values()))
        return first["code"], first["message"]
    return None


def _score_row(member: BenchMember, answer: Json) -> ScoreRow:
    person = member.subject or member.task.recording.filename
    return ScoreRow(person, answer["movement"], answer["scores"])


def _bench_summary(
    task: ComBenchTask, scored: Mapping[int, Json], left_out: list[LeftOut], rows: Sequence[tuple[str, ScoreRow]]
) -> ComBenchSummary:
    columns = mean_scores([row for _, row in rows], METHODS, task.seed)
    people = len({row.person for _, row in rows})
    trials, refused = [], []
    for index, answer in scored.items():
        member = task.members[index]
        identity = {"recording_id": member.recording_id, "filename": member.task.recording.filename}
        trials.append(TrialQuality(**identity, quality=Quality.model_validate(answer["quality"])))
        refused += [MethodRefusal(**identity, method=method, **why) for method, why in answer["refused"].items()]
    return ComBenchSummary(
        columns=[_bench_column(column) for column in columns],
        n_recordings=len(rows),
        n_people=people,
        mass=_mass_agreement([answer["masses_kg"] for answer in scored.values()]),
        refused=refused,
        left_out=left_out,
        quality=worst_quality([one.quality for one in trials]),
        trials=trials,
        warnings=_remarks(task, columns, people, left_out, scored),
    )


def _bench_column(column: ScoreColumn) -> BenchColumn:
    score = SCORES[column.score]
    return BenchColumn(
        name=f"{column.movement}_{column.score}",
        movement=column.movement,
        unit=score.unit,
        orders=score.orders,
        n=column.people,
        recordings=column.recordings,
        unmatched=column.unmatched,
        scores={method: BenchScore(**asdict(mean)) for method, mean in column.means.items()},
    )


def _mass_agreement(masses_kg: Sequence[Sequence[float | None]]) -> MassAgreement:
    shares = [measured / stated - 1.0 for stated, measured in masses_kg if stated and measured]
    if not shares:
        return MassAgreement(n=0, rms_share=None, max_share=None)
    rms = float(np.sqrt(np.mean(np.square(shares))))
    return MassAgreement(n=len(shares), rms_share=rms, max_share=float(np.max(np.abs(shares))))


def _remarks(
    task: ComBenchTask,
    columns: Sequence[ScoreColumn],
    people: int,
    left_out: Sequence[LeftOut],
    scored: Mapping[int, Json],
) -> list[base.Remark]:
    remarks = []
    if any(column.people < FEWEST_PEOPLE for column in columns):
        message = (
            f"Columns with fewer than {FEWEST_PEOPLE} people have no interval, and their order means nothing: a single "
            "recording is decided by the error of the force path."
        )
        remarks.append(base.Remark(code="few-people", message=message))
    unnamed = sum(task.members[index].subject is None for index in scored)
    if unnamed > 1:
        message = f"{unnamed} recordings have no subject; each counts as a separate person."
        remarks.append(base.Remark(code="subjects-assumed", message=message))
    unmatched = sum(column.unmatched for column in columns)
    if unmatched:
        message = (
            f"{unmatched} scores are left out because an estimator has none on the recording; columns compare the same "
            "recordings."
        )
        remarks.append(base.Remark(code="scores-unmatched", message=message))
    if left_out:
        message = f"{len(left_out)} recordings could not be scored: {', '.join(one.filename for one in left_out)}."
        remarks.append(base.Remark(code="recordings-left-out", message=message))
    return remarks + _plate_remarks(task, scored)


def _plate_remarks(task: ComBenchTask, scored: Mapping[int, Json]) -> list[base.Remark]:
    """Remark for every laboratory whose plates, by the people who walked there, are not where the files state."""
    laboratories: dict[str, dict[str, list[PlateEvidence]]] = {}
    for index, answer in scored.items():
        if found := answer.get("plates"):
            member = task.members[index]
            person = member.subject or member.task.recording.filename
            evidence = PlateEvidence(np.array(found["gram"]), np.array(found["right"]))
            laboratories.setdefault(json.dumps(found["laboratory"]), {}).setdefault(person, []).append(evidence)
    remarks = []
    for laboratory, people in laboratories.items():
        known = plate_references(people)
        if known is None or not (known.displaced_plates or known.is_high):
            continue
        indices = [int(row[0]) for row in json.loads(laboratory)]
        parts = []
        for position in known.displaced_plates:
            offset_mm, sd_mm = 1e3 * known.horizontal_m[position], 1e3 * known.horizontal_sd_m[position]
            parts.append(
                f"plate {indices[position]} by {offset_mm[0]:+.1f} mm along x and {offset_mm[1]:+.1f} mm along y (SD "
                f"{sd_mm[0]:.1f} and {sd_mm[1]:.1f}; relative to the mean of the plates)"
            )
        if known.is_high:
            parts.append(
                f"all plates by {1e3 * known.height_m:+.0f} mm vertically (SD {1e3 * known.height_sd_m:.0f}; the "
                "segment table accounts for 20)"
            )
        message = (
            f"By {known.people} people who walked over them, the moments of the plates do not refer to where the files "
            f"state: {', '.join(parts)}. Corners or origins are wrong; state moment_offset_m of the plates."
        )
        remarks.append(base.Remark(code="plates-misplaced", message=message))
    return remarks
