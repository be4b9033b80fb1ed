"""From many recordings to the wheel parameters of their subjects (section 3.3.2).

    recordings -> wheel of every step -> subjects -> means, correlations, mixed models

Recordings that cannot be fitted are listed and left out.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points
from stridelab.errors import Fault, NotEstimable, StridelabError
from stridelab.estimation.quality.assessment import CONTRADICTED, DOUBTFUL
from stridelab.pipelines.estimate_com import worst_quality
from stridelab.pipelines.fit_cycloid import fit_cycloid_of_recording
from stridelab.pipelines.population.subjects import SUBJECT_FIELDS, RecordingSubject, merge_subjects
from stridelab.pipelines.population.summary import correlation_results, mixed_results, subject_results
from stridelab.pipelines.progress import ItemMap, Json, ProgressCallback
from stridelab.recordings.recording import Remark
from stridelab.schemas import base
from stridelab.schemas.cycloid import FitCycloidTask, FittedStep
from stridelab.schemas.population import LeftOut, PersonFields, StudyPopulationSummary, StudyPopulationTask
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.walking.population.population import StepRow, study

UNUSABLE_FLAGS: Final = frozenset({"path-not-converged", "not-curtate", "r-too-large"})
"""Flags of steps without a valid wheel: they are in the table and in no mean."""
STEP_VALUES: Final = (
    *("R_m", "r_m", "z0_m", "omega_rad_s", "speed_m_s", "step_length_m"),
    *("error_mean_mm", "error_sd_mm", "error_max_mm", "circumference_share"),
)
"""Fields of a fitted step that the study takes means of."""
REFERENCES: Final = (
    "carpentier2017thesis",
    "fisher1924",
    "bonett2000",
    "efron1987",
    "holm1979",
    "laird1982",
    "patterson1971",
    "schluchter1990",
)


@dataclass(frozen=True)
class FittedRecording:
    """Result of the fit of one recording."""

    recording_id: str
    sheet: RecordingSubject
    steps: tuple[FittedStep, ...]
    method: str
    references: tuple[str, ...]
    quality: Quality


@dataclass(frozen=True)
class StudiedStep:
    """A step with its fit, the group of its subject, and whether its wheel is in the means."""

    step: StepRow
    fitted: FittedStep
    used: bool


@dataclass(frozen=True)
class PopulationResult:
    """All steps of the study, the group of every subject by name, the citation keys, and the summary."""

    steps: list[StudiedStep]
    groups: Mapping[str, str]
    citation_keys: tuple[str, ...]
    summary: StudyPopulationSummary


def study_population(
    task: StudyPopulationTask, folder: Path, map_recordings: ItemMap, progress: ProgressCallback
) -> PopulationResult:
    """Fit every recording of ``task``, by ``map_recordings``, and study the subjects.

    Raises ``NotEstimable`` (``nothing-fitted``) if no step of any recording can be fitted, ``InvalidInput``
    (``subject-in-two-groups``).
    """
    progress(0.0, f"fitting {len(task.members)} recordings")
    fitted, left_out, trials = _fit_all(task, folder, map_recordings, progress)
    progress(0.9, "studying the subjects")
    subjects, remarks = merge_subjects([one.sheet for one in fitted])
    rows = [row for one in fitted for row in _step_rows(one)]
    usable = [row for row in rows if row.used]
    population = study([s.person for s in subjects], [row.step for row in usable], pooled=task.pooled, seed=task.seed)
    methods, quality = {one.method for one in fitted}, worst_quality([one.quality for one in fitted])
    warnings = [*_quality_remarks(fitted), *remarks, *population.remarks]
    summary = StudyPopulationSummary(
        subjects=subject_results(population.subjects, {s.person.name: s for s in subjects}),
        correlations=correlation_results(population),
        mixed_models=mixed_results(population),
        left_out=left_out,
        n_recordings=len(fitted),
        n_steps=len(usable),
        method=methods.pop() if len(methods) == 1 else None,
        pooled=task.pooled,
        quality=quality,
        trials=trials,
        warnings=[base.Remark(code=r.code, message=r.message) for r in warnings] + _step_remarks(rows, left_out),
    )
    groups = {s.person.name: s.person.group for s in subjects}
    keys = (*REFERENCES, *(key for one in fitted for key in one.references))
    return PopulationResult(rows, groups, tuple(dict.fromkeys(keys)), summary)


def fit_one(item: Json) -> Json:
    """Fit the wheels of one recording, with JSON on both sides; runs in a separate process."""
    task, folder = FitCycloidTask.model_validate(item["task"]), Path(item["folder"])
    result = fit_cycloid_of_recording(task, folder, lambda _fraction, _message: None, rivals=False)
    return {
        "steps": [step.model_dump(mode="json") for step in result.summary.steps],
        "method": result.summary.method,
        "leg_m": leg_length_m(result.prepared.geometric),
        "references": list(result.citation_keys),
        "quality": result.summary.model_dump(mode="json")["quality"],
        "in_file": result.prepared.trial.recording.subject.__dict__,
    }


def leg_length_m(geometric: GeometricCom) -> float | None:
    """Leg length from hip over knee to ankle: median over the frames, mean over the visible legs."""
    joints = geometric.joint_centres_m
    legs = []
    for side in "lr":
        hip, knee, ankle = (joints.get(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        if hip is not None and knee is not None and ankle is not None:
            legs.append(_median_m(hip, knee) + _median_m(knee, ankle))
    known = [leg for leg in legs if math.isfinite(leg)]
    return float(np.mean(known)) if known else None


def _median_m(one: Points, other: Points) -> float:
    lengths = np.linalg.norm(one - other, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.median(lengths)) if len(lengths) else math.nan


def _fit_all(
    task: StudyPopulationTask, folder: Path, map_recordings: ItemMap, progress: ProgressCallback
) -> tuple[list[FittedRecording], list[LeftOut], list[TrialQuality]]:
    """Fitted recordings, recordings left out with the reason, and the quality of each fitted recording.

    A recording whose sensors contradict each other is left out, so that it is in no mean.
    """
    items = [{"task": one.task.model_dump(mode="json"), "folder": str(folder / one.folder)} for one in task.members]
    fitted: dict[int, FittedRecording] = {}
    left_out: dict[int, LeftOut] = {}
    trials: dict[int, TrialQuality] = {}
    for count, (index, answer) in enumerate(map_recordings(fit_one, items), start=1):
        one = task.members[index]
        filename = one.task.recording.filename
        if isinstance(answer, StridelabError):
            left_out[index] = LeftOut(
                recording_id=one.recording_id, filename=filename, code=answer.code, message=answer.message
            )
        elif _parse_quality(answer).verdict == CONTRADICTED:
            trials[index] = _trial_quality(one.recording_id, filename, answer)
            left_out[index] = _left_out_as_contradicted(trials[index])
        else:
            trials[index] = _trial_quality(one.recording_id, filename, answer)
            steps = tuple(FittedStep.model_validate(step) for step in answer["steps"])
            sheet = RecordingSubject(
                filename,
                _merge_subject_fields(one.person, one.task.recording.subject, answer["in_file"]),
                answer["leg_m"],
            )
            references = tuple(answer["references"])
            quality = _parse_quality(answer)
            fitted[index] = FittedRecording(one.recording_id, sheet, steps, answer["method"], references, quality)
        progress(0.88 * count / len(items), f"{count} of {len(items)} recordings fitted")
    if not fitted:
        faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in left_out.values()]
        raise NotEstimable("nothing-fitted", "In none of the recordings could a step be fitted.", faults)
    by_place = sorted(trials)
    return [fitted[i] for i in sorted(fitted)], [left_out[i] for i in sorted(left_out)], [trials[i] for i in by_place]


def _parse_quality(answer: Mapping[str, Any]) -> Quality:
    return Quality.model_validate(answer["quality"])


def _trial_quality(recording_id: str, filename: str, answer: Mapping[str, Any]) -> TrialQuality:
    return TrialQuality(recording_id=recording_id, filename=filename, quality=_parse_quality(answer))


def _left_out_as_contradicted(one: TrialQuality) -> LeftOut:
    wrong = [check.message for check in one.quality.checks if check.value > check.contradicted_above]
    message = f"The sensors of this recording contradict each other. {' '.join(wrong)}"
    return LeftOut(recording_id=one.recording_id, filename=one.filename, code=CONTRADICTED, message=message)


def _merge_subject_fields(table: PersonFields, stated: Any, in_file: Mapping[str, Any]) -> PersonFields:
    """Fields of a subject, each from the subject table, else as stated for the recording, else from the file."""

    def first_known(field: str) -> Any:
        sources = (getattr(table, field), getattr(stated, field), in_file.get(field))
        return next((value for value in sources if value is not None), None)

    return PersonFields(
        subject=table.subject or stated.name,
        group=table.group,
        **{field: first_known(field) for field in SUBJECT_FIELDS},
    )


def _step_rows(one: FittedRecording) -> list[StudiedStep]:
    return [
        StudiedStep(
            StepRow(one.sheet.subject_name, one.sheet.filename, _step_values(step)),
            step,
            not UNUSABLE_FLAGS & set(step.flags),
        )
        for step in one.steps
    ]


def _step_values(step: FittedStep) -> dict[str, float]:
    rule = [
        math.nan if model is None else model - measured
        for model, measured in zip(step.double_support_model_s, step.double_support_s, strict=True)
    ]
    known = {name: getattr(step, name) for name in STEP_VALUES}
    known |= {"double_support_start_error_s": rule[0], "double_support_end_error_s": rule[1]}
    return {name: math.nan if value is None else value for name, value in known.items()}


def _quality_remarks(fitted: Sequence[FittedRecording]) -> list[Remark]:
    doubtful = [one.sheet.filename for one in fitted if one.quality.verdict == DOUBTFUL]
    if not doubtful:
        return []
    message = f"Not every check passes in {len(doubtful)} of {len(fitted)} recordings: {', '.join(doubtful)}."
    return [Remark(DOUBTFUL, message)]


def _step_remarks(rows: Sequence[StudiedStep], left_out: Sequence[LeftOut]) -> list[base.Remark]:
    remarks = []
    unused = sum(not row.used for row in rows)
    if unused:
        message = f"{unused} of {len(rows)} steps have no usable wheel; they are in the table and in no mean."
        remarks.append(base.Remark(code="steps-not-used", message=message))
    if left_out:
        filenames = ", ".join(one.filename for one in left_out)
        message = f"{len(left_out)} recordings could not be fitted and are left out: {filenames}."
        remarks.append(base.Remark(code="recordings-left-out", message=message))
    return remarks
