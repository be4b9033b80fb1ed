"""Figure 2.9 on runners: what is an offset, what makes it that of a body, and which mass and files a run has."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from zipfile import ZipFile

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotFound
from stridelab.recordings.recording import Window, WrenchTrack
from stridelab.reproduction.chapter2 import fig_2_9_people
from stridelab.reproduction.chapter2.fig_2_9_people import LIKE_THESIS, SAME_M, SPEEDS, FusedRun
from stridelab.reproduction.claims import Claim
from stridelab.reproduction.common import recorded_walks
from stridelab.reproduction.common.recorded_walks import mass_of_runner_kg, read_trial
from support.recorded_claims import assert_as_recorded
from support.reproduction_fixtures import RisingProgress

RATE_HZ = 100.0
OFFSETS_M = np.array([[0.016, 0.002, -0.010], [0.020, -0.002, -0.012], [0.012, 0.001, -0.008]])


def fused_run(person: int, speed_m_s: int, offset_m: np.ndarray, drift_m: float = 0.0) -> FusedRun:
    """Five seconds whose first and last 1.5 s are useless, with a jump of ``drift_m`` in the middle."""
    t = np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    offset = np.tile(offset_m, (len(t), 1))
    offset[t >= 2.5] += drift_m
    offset[(t < 1.5) | (t > 3.5)] = 1.0
    return FusedRun(str(person), speed_m_s, 70.0, t, offset, np.array([0.30, 0.34, 0.97]), 0.33)


def claims_of(runs: list[FusedRun]) -> dict[str, Claim]:
    by_speed = {speed: [one for one in runs if one.speed_m_s == speed] for speed in SPEEDS}
    claims = (
        *fig_2_9_people._size_claims(by_speed[LIKE_THESIS]),
        *fig_2_9_people._constancy_claims(by_speed),
        *fig_2_9_people._rule_claims(runs),
    )
    return {claim.key: claim for claim in claims}


def test_offsets_are_those_of_settled_samples() -> None:
    """Few centimetres ahead, millimetres sideways; the largest axis of the drift counts."""
    runs = [fused_run(k, speed, at, 0.001) for k, at in enumerate(OFFSETS_M) for speed in SPEEDS]
    claims = claims_of([*runs, fused_run(3, SPEEDS[0], OFFSETS_M[0]), fused_run(4, SPEEDS[-1], OFFSETS_M[0])])
    assert claims["offset_along_m"].ours == pytest.approx(0.0165, abs=1e-4)
    assert claims["offset_along_m"].verdict == "met"
    assert claims["offset_left_m"].ours < 0.003
    assert claims["offset_left_m"].verdict == "not_met"
    assert claims["offset_up_m"].verdict == "undecided"
    assert claims["drift_m"].ours == pytest.approx(0.001, abs=1e-4)
    assert claims["drift_m"].verdict == "met"
    assert claims["bias_left"].ours == pytest.approx(0.34)
    assert claims["bias_left"].verdict == "met"
    assert claims["vertical_left"].verdict == "not_met", "by a bound of ours"
    assert claims["bias_left_predicted"].ours == pytest.approx(0.01)
    assert claims["bias_left_predicted"].outcome == "aim_reached"
    assert {claims[key].n for key in ("offset_along_m", "change_along_m", "drift_m")} == {3}
    assert_as_recorded("runs of invented offsets", claims.values())


def test_an_offset_that_grows_with_the_speed_is_not_that_of_a_table() -> None:
    """Signs do not cancel: a change of opposite directions in two people is a change."""
    changed = [
        fused_run(k, speed, at + (speed == SPEEDS[-1]) * np.array([(-1) ** k * 2.0 * SAME_M, 0.0, 0.0]))
        for k, at in enumerate(OFFSETS_M)
        for speed in SPEEDS
    ]
    claims = claims_of(changed)
    assert claims["change_along_m"].ours == pytest.approx(2.0 * SAME_M)
    assert claims["change_along_m"].verdict == "not_met"
    assert claims["change_left_m"].verdict == "met"
    drifting = claims_of([fused_run(k, s, at, 2.0 * SAME_M) for k, at in enumerate(OFFSETS_M) for s in SPEEDS])
    assert drifting["drift_m"].verdict == "not_met"


def test_drifts_and_what_is_left_of_a_bias_are_means() -> None:
    """An offset that grows by 10 mm a second differs by 10 mm between halves of a second each; people differ."""
    runs = [fused_run(k, LIKE_THESIS, at) for k, at in enumerate(OFFSETS_M)]
    for run in runs:
        run.offset_m[run.settled_samples, 0] += 0.01 * run.time_s[run.settled_samples]
        assert run.drift_m == pytest.approx([0.01, 0.0, 0.0], abs=1e-4)
    left = ((0.1, 0.3, 0.9), (0.2, 0.4, 0.7), (0.3, 0.1, 0.5))
    shared = [replace(run, left_over=np.array(of)) for run, of in zip(runs, left, strict=True)]
    claims = {claim.key: claim for claim in fig_2_9_people._rule_claims(shared)}
    assert claims["bias_left"].ours == pytest.approx((0.3 + 0.4 + 0.3) / 3.0), "the worse axis of each"
    assert claims["vertical_left"].ours == pytest.approx((0.9 + 0.7 + 0.5) / 3.0)
    assert claims["bias_left_predicted"].ours == pytest.approx((0.13 + 0.03 + 0.13) / 3.0), "from 0.33 aloft"
    again = replace(shared[0], left_over=np.array([0.5, 0.1, 0.3]))
    twice = {claim.key: claim for claim in fig_2_9_people._rule_claims([*shared, again])}
    assert twice["bias_left"].ours == pytest.approx(((0.3 + 0.5) / 2.0 + 0.4 + 0.3) / 3.0), "two runs of one person"


def hopping_runner(bias_m: np.ndarray, ahead: np.ndarray, still_s: float = 0.0) -> SimpleNamespace:
    """Hops in place for 9 s with a third of each 0.36 s in the air; the table is wrong by ``bias_m``, L' is zero.

    Stands still until ``still_s``.
    """
    t = np.arange(0.0, 9.0, 1.0 / RATE_HZ)
    phase = (t / 0.36) % 1.0
    up_n = np.where(phase < 2.0 / 3.0, 1.5 * 70.0 * GRAVITY_M_S2, 0.0)
    up_n *= 70.0 * GRAVITY_M_S2 / up_n[: 36 * (len(t) // 36)].mean()
    up_n[t < still_s] = 70.0 * GRAVITY_M_S2
    lift = up_n / 70.0 - GRAVITY_M_S2
    height = np.cumsum(np.cumsum(lift)) / RATE_HZ**2
    height -= np.polyval(np.polyfit(t, height, 1), t) - 0.95
    com_m = np.column_stack([0.0 * t, 0.0 * t, height])
    force_n = np.column_stack([0.0 * t, 0.0 * t, up_n])
    track = WrenchTrack(t, force_n, np.cross(com_m, force_n), np.ones(len(t), dtype=bool), (Window(0.0, float(t[-1])),))
    recording = SimpleNamespace(marker_rate_hz=RATE_HZ, walking_direction=ahead)
    return SimpleNamespace(
        recording=recording, mass_kg=70.0, geometric=SimpleNamespace(com_m=com_m + bias_m), total_wrench=lambda _: track
    )


def test_the_filter_takes_away_what_the_table_is_wrong_by_but_for_the_time_in_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever way the runner faces; a third of the bias stays, and all of that of the height."""
    bias_m = np.array([0.03, -0.02, 0.01])
    for ahead, expected in (([1.0, 0.0, 0.0], [0.03, -0.02]), ([0.0, 1.0, 0.0], [-0.02, -0.03])):
        runner = hopping_runner(bias_m, np.array(ahead))
        monkeypatch.setattr(recorded_walks.RecordedWalk, "from_file", lambda _path, runner=runner: runner)
        run = fig_2_9_people.fuse_run(Path("hamner/person7/Run_4.trc"))
        assert (run.person, run.speed_m_s, run.mass_kg) == ("person7", 4, 70.0)
        assert run.aloft == pytest.approx(1.0 / 3.0, abs=0.02)
        assert run.left_over[:2] == pytest.approx([run.aloft] * 2, abs=0.02)
        assert run.left_over[2] > 0.95
        assert run.mean_m[:2] == pytest.approx([-(1.0 - run.aloft) * size for size in expected], abs=0.001)
        assert abs(run.mean_m[2]) < 0.001
        assert np.abs(run.drift_m).max() < 0.001
        settled = run.time_s[run.settled_samples]
        assert (settled[0], settled[-1]) == pytest.approx((1.5, 9.0 - 1.5), abs=0.02)


def test_what_the_filter_leaves_is_a_mean_over_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the run without flight: half of what is left of a bias, not the most that is left at any time."""
    runner = hopping_runner(np.zeros(3), np.array([1.0, 0.0, 0.0]), still_s=4.5)
    monkeypatch.setattr(recorded_walks.RecordedWalk, "from_file", lambda _path: runner)
    run = fig_2_9_people.fuse_run(Path("hamner/person7/Run_4.trc"))
    assert run.aloft == pytest.approx(1.0 / 6.0, abs=0.02)
    assert run.left_over[:2] == pytest.approx([run.aloft] * 2, abs=0.03)


def test_samples_without_force_or_without_geometry_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """At both ends: a sample needs both."""
    runner = hopping_runner(np.array([0.03, -0.02, 0.01]), np.array([1.0, 0.0, 0.0]))
    monkeypatch.setattr(recorded_walks.RecordedWalk, "from_file", lambda _path: runner)
    runner.total_wrench(0.0).complete[-30:] = False
    runner.geometric.com_m[:20] = np.nan
    run = fig_2_9_people.fuse_run(Path("hamner/person7/Run_4.trc"))
    assert (run.time_s[0], run.time_s[-1]) == pytest.approx((0.2, 9.0 - 0.31))
    assert np.isfinite(run.offset_m).all()


def test_runs_that_cannot_be_used_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for person in ("one", "two"):
        for speed in SPEEDS:
            path = tmp_path / "running" / person / f"Run_{speed}.trc"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()

    def fuse(path: Path) -> FusedRun:
        if path.parent.name == "two" and path.stem == "Run_3":
            raise NotFound("recordings-missing", "The file is cut.")
        return fused_run(("one", "two").index(path.parent.name), int(path.stem[-1]), OFFSETS_M[0])

    monkeypatch.setattr(fig_2_9_people, "fuse_run", fuse)
    result = fig_2_9_people.run(tmp_path, RisingProgress())
    assert result.note.endswith("Left out: two/Run_3.trc (The file is cut).")
    assert "2 runners" in result.note
    assert "7 runs, 1 refused" in result.note
    assert result.tables["offsets"]["speed_m_s"].tolist() == [2, 4, 5], "a speed of one person has no deviation"


def run_on_plates(flights: int, mass_kg: float) -> WrenchTrack:
    """Contacts of half a period whose mean force is the weight, cut amid a contact at both ends."""
    t = np.arange(0.0, 0.35 * (flights + 0.8), 1e-3)
    phase = (t / 0.35 + 0.2) % 1.0
    up_n = np.where(phase < 0.5, 2.0 * mass_kg * GRAVITY_M_S2, 0.0)
    force_n = np.column_stack([np.zeros((len(t), 2)), up_n])
    whole = np.ones(len(t), dtype=bool)
    return WrenchTrack(t, force_n, np.zeros_like(force_n), whole, (Window(0.0, float(t[-1])),))


def test_the_mass_of_a_runner_is_that_of_whole_steps() -> None:
    assert mass_of_runner_kg(run_on_plates(8, 65.0)) == pytest.approx(65.0, rel=5e-3)
    assert mass_of_runner_kg(run_on_plates(5, 65.0)) == pytest.approx(65.0, rel=5e-3), "five flights are enough"
    assert mass_of_runner_kg(run_on_plates(4, 65.0)) is None
    loaded = run_on_plates(5, 65.0)
    loaded.force_n[loaded.time_s > loaded.time_s[-1] - 2.1 * 0.35, 2] *= 1.4
    assert mass_of_runner_kg(loaded) == pytest.approx(65.0 * 1.1, rel=5e-3), "the last of four steps is one of them"
    hidden = run_on_plates(8, 65.0)
    hidden.complete[len(hidden.complete) // 2] = False
    assert mass_of_runner_kg(hidden) is None


def test_a_trc_file_is_read_with_its_forces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a zip of both; without forces alone."""

    def refuse(path: Path, name: str | None = None) -> None:
        raise NotFound("read", f"{path.suffix} {name} {sorted(ZipFile(path).namelist()) if name else ''}")

    monkeypatch.setattr(recorded_walks, "read_recording", refuse)
    for name in ("static.trc", "Run_4.trc", "Run_4_grf.mot"):
        (tmp_path / name).write_text("PathFileType")
    with pytest.raises(NotFound, match=r"\.trc None"):
        read_trial(tmp_path / "static.trc")
    with pytest.raises(NotFound, match=r"\.zip Run_4\.trc \['Run_4\.trc', 'Run_4_grf\.mot'\]"):
        read_trial(tmp_path / "Run_4.trc")


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no recording"):
        fig_2_9_people.run(tmp_path, lambda _fraction, _message: None)
