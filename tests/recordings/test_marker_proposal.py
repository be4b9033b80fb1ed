"""Proposed marker maps of simulated walks whose labels were replaced and whose markers were shuffled."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stridelab.recordings.marker_proposal import propose_marker_map
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording
from stridelab.simulation.human.marker_layout import LABELS
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

WORDS = {
    "asis": "PelvisAnt",
    "psis": "PelvisPost",
    "knee_lateral": "KneeLatEpi",
    "ankle_lateral": "AnkleLatMal",
    "heel": "CalcPost",
    "mt2": "Metatars2",
    "acromion": "ShoulderAC",
    "elbow_lateral": "ElbowLatEpi",
    "wrist_radial": "WristRadSt",
    "c7": "NeckC7",
    "t10": "BackT10",
    "jugular_notch": "SternTop",
    "xiphoid": "SternLow",
}
"""Words of a laboratory for 22 landmarks, none of them in a shipped set."""
WALKERS = {
    "adult": HumanWalker(mass_kg=72.0, speed_m_s=1.3, duration_s=4.0, seed=4),
    "small": HumanWalker(mass_kg=45.0, height_m=1.35, speed_m_s=0.9, duration_s=4.0, seed=7),
    "tall": HumanWalker(mass_kg=90.0, height_m=1.95, speed_m_s=1.5, duration_s=4.0, seed=9),
}


@cache
def walk(name: str) -> Recording:
    """A simulated walk with 22 markers, 3 mm of noise and the true landmarks as labels."""
    recording = record(WALKERS[name].walk(), MeasurementNoise(marker_m=0.003), 1).recording
    names = [mark for mark in LABELS if mark.removeprefix("l_").removeprefix("r_") in WORDS]
    assert len(names) == 22
    return replace(recording, markers_m={mark: recording.markers_m[LABELS[mark]] for mark in names})


def relabelled(recording: Recording, labels: Mapping[str, str], seed: int = 3, turn_rad: float = 0.0) -> Recording:
    """The recording with other labels, its markers in random order, and turned about the vertical."""
    order = np.random.default_rng(seed).permutation(list(labels))
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    markers = {labels[str(mark)]: recording.markers_m[str(mark)] @ turn.T for mark in order}
    ahead = recording.walking_direction
    return replace(recording, markers_m=markers, walking_direction=None if ahead is None else turn @ ahead)


def informative(mark: str) -> str:
    side, _, name = mark.partition("_")
    return WORDS[mark] if mark in WORDS else f"{WORDS[name]}_{'Left' if side == 'l' else 'Right'}"


def n_right(recording: Recording, labels: Mapping[str, str]) -> int:
    proposal = propose_marker_map(recording)
    return sum(mark in proposal and proposal[mark].label == label for mark, label in labels.items())


@pytest.mark.parametrize("name", WALKERS)
@pytest.mark.parametrize("turn_rad", [0.0, 2.0])
def test_informative_labels_are_proposed_for_their_landmark(name: str, turn_rad: float) -> None:
    labels = {mark: informative(mark) for mark in walk(name).markers_m}
    assert identify(list(labels.values())).name is None
    assert n_right(relabelled(walk(name), labels, turn_rad=turn_rad), labels) >= 20


@pytest.mark.parametrize("name", WALKERS)
@pytest.mark.parametrize("turn_rad", [0.0, 2.0])
def test_meaningless_labels_are_assigned_by_position(name: str, turn_rad: float) -> None:
    """From position and motion alone at least 17 of 22 landmarks are right, and those of high confidence always."""
    labels = {mark: f"M{k:03d}" for k, mark in enumerate(walk(name).markers_m)}
    recording = relabelled(walk(name), labels, turn_rad=turn_rad)
    assert n_right(recording, labels) >= 17
    confident = {mark: one.label for mark, one in propose_marker_map(recording).items() if one.confidence > 0.9}
    assert len(confident) >= 6
    assert confident == {mark: labels[mark] for mark in confident}


def test_markers_that_are_no_landmarks_are_left_out() -> None:
    recording = walk("adult")
    labels = {mark: informative(mark) for mark in recording.markers_m}
    far = {f"X{k}": recording.markers_m["c7"] + np.array([1.5 + k, 2.0, 1.0]) for k in range(3)}
    marked = relabelled(recording, labels)
    proposal = propose_marker_map(replace(marked, markers_m={**marked.markers_m, **far}))
    assert not set(far) & {one.label for one in proposal.values()}
    assert n_right(replace(marked, markers_m={**marked.markers_m, **far}), labels) >= 20


def test_gaps_are_tolerated_and_hardly_visible_markers_left_out() -> None:
    recording = walk("adult")
    labels = {mark: informative(mark) for mark in recording.markers_m}
    marked = dict(relabelled(recording, labels).markers_m)
    hidden = labels["c7"]
    marked[hidden] = np.where(np.arange(len(marked[hidden]))[:, None] < 10, marked[hidden], np.nan)
    marked[labels["l_heel"]] = marked[labels["l_heel"]].copy()
    marked[labels["l_heel"]][50:200] = np.nan
    proposal = propose_marker_map(replace(recording, markers_m=marked))
    assert "c7" not in proposal
    assert proposal["l_heel"].label == labels["l_heel"]
    assert propose_marker_map(replace(recording, markers_m={"A": marked[hidden]})) == {}
