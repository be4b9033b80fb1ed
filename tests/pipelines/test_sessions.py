"""Sessions made by simulation, whose latency and mass are known, from trials that do not show them well."""

import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.pipelines.session_values import TrialFacts, select_static_trial, session_values
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording, Subject
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.schemas.recordings import RecordingFacts
from stridelab.schemas.sessions import SessionValues
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.parse_upload import recording_facts
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import quiet

LATE_S, MASS_KG = 0.018, 64.0
MEDIAL = ("LMEPI", "RMEPI")


@dataclass(frozen=True)
class Made:
    """Files of a session, and the facts of each."""

    folder: Path
    facts: dict[str, RecordingFacts]

    def trials(self, own: str) -> tuple[TrialFacts, list[TrialFacts]]:
        all_of_them = {name: TrialFacts(name, name, name, result) for name, result in self.facts.items()}
        return all_of_them[own], [one for name, one in all_of_them.items() if name != own]

    def values(self, own: str) -> SessionValues:
        one, others = self.trials(own)
        result = session_values("s", one, others)
        assert result is not None
        return result


def put(folder: Path, name: str, recording: Recording) -> RecordingFacts:
    write_c3d(folder / name, recording)
    return recording_facts(examine_trial(RecordingSource(file=name, filename=name), folder))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Five times a walk over two plates, with other noise and another wrong table; markers of two are very noisy."""
    folder = tmp_path_factory.mktemp("session")
    result = {}
    walk = HumanWalker(mass_kg=MASS_KG, speed_m_s=1.2, duration_s=3.0, seed=4).walk()
    for k in range(5):
        marker_m = 0.006 if k < 2 else 0.001
        noise = MeasurementNoise(force_n=4.0, marker_m=marker_m, mass_model=0.2, latency_s=LATE_S)
        recording = record(walk, noise, k, lab="two_plates").recording
        unweighed = replace(recording, subject=Subject(recording.subject.height_m, None, recording.subject.sex))
        result[f"walk{k}.c3d"] = put(folder, f"walk{k}.c3d", unweighed)
    return Made(folder, result)


def estimated(made: Made, own: str, folder: Path, session: SessionValues | None, **asked: object) -> EstimateComSummary:
    folder.mkdir(exist_ok=True)
    shutil.copyfile(made.folder / own, folder / "trial")
    task = EstimateComTask(
        recording=RecordingSource(file="trial", filename=own),
        session=session,
        input=EstimateComInput.model_validate({"recording_id": own, "method": "complementary", **asked}),
    )
    return EstimateComSummary.model_validate(estimate_com.run(task, folder, quiet).summary)


def test_every_trial_states_its_clock_and_its_weight(session: Made) -> None:
    for result in session.facts.values():
        assert result.clock is not None
        assert result.mass_from_force_kg is not None
        assert result.mass_from_force_sd_kg is not None
        assert result.simulated
        assert not result.still
        assert result.recorded_on is None


def test_the_session_knows_its_clock_better_than_its_worst_trial(session: Made) -> None:
    values = session.values("walk0.c3d")
    assert values.latency_s is not None
    assert values.latency_sd_s is not None
    errors_s = [abs(one.clock.latency_s - LATE_S) for one in session.facts.values() if one.clock is not None]
    assert values.latency_n_trials == 5
    assert abs(values.latency_s - LATE_S) < min(0.0015, 3 * values.latency_sd_s)
    assert abs(values.latency_s - LATE_S) < max(errors_s) / 2
    assert values.latency_sd_s < min(one.clock.sd_s for one in session.facts.values() if one.clock is not None) * 1.01


def test_the_session_weighs_the_person(session: Made) -> None:
    values = session.values("walk0.c3d")
    assert values.mass_kg is not None
    assert values.mass_kg == pytest.approx(MASS_KG, rel=0.02)
    assert values.mass_sd_kg is not None
    assert abs(values.mass_kg - MASS_KG) < 3 * values.mass_sd_kg


def test_an_estimate_uses_its_session_and_says_so(session: Made, tmp_path: Path) -> None:
    values = session.values("walk0.c3d")
    alone = estimated(session, "walk0.c3d", tmp_path / "alone", None)
    together = estimated(session, "walk0.c3d", tmp_path / "together", values)
    assert (alone.latency_source, alone.latency_n_trials, alone.session) == ("trial", 1, None)
    assert alone.latency_s == alone.latency_trial_s
    assert (together.latency_source, together.latency_n_trials) == ("session", 5)
    assert together.latency_s == together.latency_applied_s == values.latency_s
    assert together.latency_sd_s == values.latency_sd_s
    assert together.latency_trial_s == pytest.approx(alone.latency_s, abs=2e-4)  # it is the mass that differs
    assert together.session == values
    assert together.mass_kg == values.mass_kg
    assert together.mass_from_force_kg == alone.mass_from_force_kg
    codes = {remark.code: remark.message for remark in together.warnings}
    assert "over 5 trials" in codes["latency-applied"]
    assert "over 5 trials of the session" in codes["mass-from-session"]


def test_the_recorded_values_give_the_result_again(session: Made, tmp_path: Path) -> None:
    """What the result records is all that it took from the session: other trials may come or go meanwhile."""
    first = estimated(session, "walk3.c3d", tmp_path / "first", session.values("walk3.c3d"))
    again = estimated(session, "walk3.c3d", tmp_path / "again", first.session)
    assert again == first
    assert (tmp_path / "first" / "com.csv").read_bytes() == (tmp_path / "again" / "com.csv").read_bytes()


def test_all_trials_of_a_session_have_one_latency_and_one_mass(session: Made, tmp_path: Path) -> None:
    result = [estimated(session, name, tmp_path / name, session.values(name)) for name in sorted(session.facts)[2:]]
    assert len({one.latency_applied_s for one in result}) == 1
    assert len({one.mass_kg for one in result}) == 1


@pytest.mark.parametrize(("wanted", "applied_s"), [("report", 0.0), (0.007, 0.007)])
def test_report_and_a_number_stand_above_the_session(
    session: Made, tmp_path: Path, wanted: object, applied_s: float
) -> None:
    summary = estimated(session, "walk2.c3d", tmp_path / "run", session.values("walk2.c3d"), latency=wanted)
    assert summary.latency_applied_s == applied_s
    assert summary.latency_source == "session"
    assert summary.latency_s == session.values("walk2.c3d").latency_s


def test_a_stated_mass_stands_above_the_session(session: Made, tmp_path: Path) -> None:
    shutil.copyfile(session.folder / "walk2.c3d", tmp_path / "trial")
    task = EstimateComTask.model_validate(
        {
            "recording": {"file": "trial", "filename": "walk2.c3d", "subject": {"mass_kg": 68.0}},
            "session": session.values("walk2.c3d").model_dump(),
            "input": {"recording_id": "r", "method": "complementary"},
        }
    )
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path, quiet).summary)
    assert (summary.mass_kg, summary.mass_source) == (68.0, "stated")
    assert "mass-differs-from-force" in {remark.code for remark in summary.warnings}


def test_a_trial_that_contradicts_its_session_is_noted(session: Made, tmp_path: Path) -> None:
    values = session.values("walk4.c3d").model_copy(update={"latency_s": -0.02, "latency_excess_s": 0.0})
    summary = estimated(session, "walk4.c3d", tmp_path / "run", values)
    assert "latency-differs-from-session" in {remark.code for remark in summary.warnings}
    assert summary.latency_applied_s == -0.02


@pytest.mark.parametrize(("factor", "noted"), [(1.0, False), (0.96, True)])
def test_a_trial_that_weighs_another_person_than_its_session_is_noted(
    session: Made, tmp_path: Path, factor: float, noted: bool
) -> None:
    values = session.values("walk2.c3d")
    values = values.model_copy(update={"mass_kg": (values.mass_kg or 0.0) * factor})
    summary = estimated(session, "walk2.c3d", tmp_path / "run", values)
    assert ("mass-differs-from-session" in {remark.code for remark in summary.warnings}) is noted


# Static trials.


def standing(recording: Recording, n: int = 60) -> Recording:
    """The first frame of a walk, held for ``n`` frames, without plates."""
    held = {label: np.repeat(track[:1], n, axis=0) for label, track in recording.markers_m.items()}
    return replace(recording, markers_m=held, plates=(), events=(), walking_direction=None, carried={})


@pytest.fixture(scope="module")
def whole() -> Recording:
    walk = HumanWalker(mass_kg=MASS_KG, duration_s=3.0, seed=11).walk()
    return record(walk, MeasurementNoise(latency_s=LATE_S), 11, lab="two_plates").recording


def with_static(
    folder: Path,
    walk: Recording,
    static: Recording,
    *,
    chosen: bool,
    marker_map: dict[str, str] | None = None,
) -> EstimateComSummary:
    folder.mkdir(exist_ok=True)
    write_c3d(folder / "trial", walk)
    write_c3d(folder / "static-trial", static)
    values = SessionValues(session_id="s", static_recording_id="static.c3d") if chosen else None
    task = EstimateComTask(
        recording=RecordingSource(file="trial", filename="walk.c3d", marker_map=marker_map or {}),
        static=RecordingSource(file="static-trial", filename="static.c3d"),
        session=values,
        input=EstimateComInput(recording_id="r", method="geometry", segment_table="dumas2007"),
    )
    return EstimateComSummary.model_validate(estimate_com.run(task, folder, quiet).summary)


def without(recording: Recording, labels: list[str]) -> Recording:
    left = {label: track for label, track in recording.markers_m.items() if label not in labels}
    return replace(recording, markers_m=left, carried={})


def renamed(recording: Recording, names: dict[str, str]) -> Recording:
    return replace(
        recording, markers_m={names.get(label, label): track for label, track in recording.markers_m.items()}
    )


def medial_knees(recording: Recording) -> list[str]:
    landmarks = identify(tuple(recording.markers_m)).landmarks
    return [landmarks["l_knee_medial"], landmarks["r_knee_medial"]]


def test_markers_that_only_the_static_trial_has_are_rebuilt(whole: Recording, tmp_path: Path) -> None:
    medial = medial_knees(whole)
    summary = with_static(tmp_path / "run", without(whole, medial), standing(whole), chosen=True)
    codes = {remark.code: remark.message for remark in summary.warnings}
    assert "static.c3d" in codes["static-from-session"]
    assert "l_knee_medial, r_knee_medial" in codes["markers-rebuilt"]
    assert summary.session is not None
    assert summary.session.static_recording_id == "static.c3d"


@pytest.mark.parametrize("chosen", [True, False])
def test_labels_of_the_static_trial_alone_can_be_mapped(whole: Recording, tmp_path: Path, chosen: bool) -> None:
    medial = medial_knees(whole)
    static = renamed(standing(whole), dict(zip(medial, MEDIAL, strict=True)))
    mapped = dict(zip(("l_knee_medial", "r_knee_medial"), MEDIAL, strict=True))
    summary = with_static(tmp_path / "run", without(whole, medial), static, chosen=chosen, marker_map=mapped)
    codes = {remark.code: remark.message for remark in summary.warnings}
    assert "l_knee_medial, r_knee_medial" in codes["markers-rebuilt"]
    unmapped = with_static(tmp_path / "other", without(whole, medial), static, chosen=chosen)
    assert "l_knee_medial" not in {r.code: r.message for r in unmapped.warnings}.get("markers-rebuilt", "")


def test_a_label_that_neither_has_is_refused(whole: Recording, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        with_static(tmp_path / "run", whole, standing(whole), chosen=True, marker_map={"l_knee_medial": "LMEPI"})
    assert refusal.value.code == "unknown-marker"


def test_a_static_trial_of_unknown_labels_is_refused_or_said(whole: Recording, tmp_path: Path) -> None:
    strange = renamed(standing(whole), {label: f"QX{i}" for i, label in enumerate(whole.markers_m)})
    with pytest.raises(InvalidInput) as refusal:
        with_static(tmp_path / "stated", whole, strange, chosen=False)
    assert refusal.value.code == "static-unusable"
    assert "static.c3d" in refusal.value.message
    summary = with_static(tmp_path / "found", whole, strange, chosen=True)
    codes = {remark.code: remark.message for remark in summary.warnings}
    assert "static.c3d" in codes["static-not-used"]
    assert summary.session is not None
    assert summary.session.static_recording_id is None


def test_a_static_trial_whose_set_is_unknown_gives_what_it_shares_and_says_so(whole: Recording, tmp_path: Path) -> None:
    stored = list(whole.markers_m)[:6]
    poor = without(standing(whole), [label for label in whole.markers_m if label not in stored])
    summary = with_static(tmp_path / "run", whole, poor, chosen=False)
    assert "static-set-unknown" in {remark.code for remark in summary.warnings}


PLUG_IN_GAIT = {
    "asis": "ASI", "psis": "PSI", "knee_lateral": "KNE", "knee_medial": "MKNE", "ankle_lateral": "ANK",
    "ankle_medial": "MED", "heel": "HEE", "mt2": "TOE", "acromion": "SHO", "elbow_lateral": "ELB",
}  # fmt: skip
DOUBTS = {"static-not-still", "static-other-body", "static-labels-differ", "static-set-unknown"}


def doubts(summary: EstimateComSummary) -> dict[str, str]:
    """Remarks that the static trial may be the wrong one."""
    return {remark.code: remark.message for remark in summary.warnings if remark.code in DOUBTS}


@pytest.mark.parametrize("chosen", [True, False])
def test_a_static_trial_of_the_same_body_is_not_doubted(whole: Recording, tmp_path: Path, chosen: bool) -> None:
    assert doubts(with_static(tmp_path / "run", whole, standing(whole), chosen=chosen)) == {}


def test_a_static_trial_without_standing_still_is_remarked_on(whole: Recording, tmp_path: Path) -> None:
    walking = replace(whole, plates=(), carried={})
    doubted = doubts(with_static(tmp_path / "run", whole, walking, chosen=False))
    assert set(doubted) == {"static-not-still"}
    assert "static.c3d" in doubted["static-not-still"]


def test_a_static_trial_of_another_body_is_said(whole: Recording, tmp_path: Path) -> None:
    """A body a tenth taller, whose shank is 4 cm longer."""
    still = standing(whole)
    taller = replace(still, markers_m={label: 1.1 * track for label, track in still.markers_m.items()})
    doubted = doubts(with_static(tmp_path / "run", whole, taller, chosen=False))
    assert set(doubted) == {"static-other-body"}
    assert "static.c3d" in doubted["static-other-body"]
    assert re.search(r"_knee_lateral and ._ankle_lateral are \d+ mm apart there and \d+ mm here", str(doubted))


def test_a_static_trial_of_other_labels_is_said(whole: Recording, tmp_path: Path) -> None:
    landmarks = identify(tuple(whole.markers_m)).landmarks
    names = {landmarks[f"{s}_{name}"]: f"{s.upper()}{label}" for name, label in PLUG_IN_GAIT.items() for s in "lr"}
    names |= {landmarks["c7"]: "C7", landmarks["jugular_notch"]: "CLAV"}
    static = without(standing(whole), [label for label in whole.markers_m if label not in names])
    doubted = doubts(with_static(tmp_path / "run", whole, renamed(static, names), chosen=False))
    assert set(doubted) == {"static-labels-differ"}
    assert f"0 of the {len(landmarks)} labels" in doubted["static-labels-differ"]
    assert "plug-in-gait" in doubted["static-labels-differ"]


def test_the_session_finds_its_static_trial(session: Made, whole: Recording, tmp_path: Path) -> None:
    own, others = session.trials("walk0.c3d")
    assert select_static_trial(own, others) is None
    still = put(tmp_path, "static.c3d", standing(whole))
    assert still.still
    selected = select_static_trial(own, [*others, TrialFacts("static.c3d", "static.c3d", "x", still)])
    assert selected is not None
    assert selected.recording_id == "static.c3d"
