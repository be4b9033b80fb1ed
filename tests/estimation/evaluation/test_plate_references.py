"""Offsets of plates' moments, recovered from drawn people who walk over them; the generator shares no code with it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from experiments.people.sensors import SensorErrors, draw_recording
from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.evaluation.plate_references import (
    FEWEST_PEOPLE,
    PlateEvidence,
    PlateReferences,
    plate_evidence,
    plate_references,
)
from stridelab.recordings.recording import WrenchTrack

EXACT_PLATES = SensorErrors(plate_n=0.0, plate_nm=0.0, drift_n_s=0.0, noise_n=0.0, noise_nm=0.0, late_s=(0.0, 0.0))
PEOPLE = 8
OFFSETS_M = np.array([[0.0, 0.0, -0.06], [-0.011, 0.004, -0.06]])


@cache
def walks() -> list[tuple[GeometricCom, WrenchTrack, np.ndarray, float]]:
    """Walks of drawn people whose force a first plate carries until the middle, then, within 0.1 s, a second one."""
    result = []
    for seed in range(PEOPLE):
        drawn = draw_recording(7000 + seed, "walk", EXACT_PLATES, 2.5, 50.0)
        wrench = drawn.wrench_at(0.0)
        complete = np.flatnonzero(wrench.complete)
        middle = wrench.time_s[complete].mean()
        second = np.clip((wrench.time_s - middle) / 0.1 + 0.5, 0.0, 1.0)[:, None]
        forces = np.array([(1.0 - second) * wrench.force_n, second * wrench.force_n])
        result.append((drawn.geometric, wrench, forces, drawn.mass_kg))
    return result


def identified(offsets_m: np.ndarray, people: int = PEOPLE) -> PlateReferences | None:
    """Offsets that are estimated if the moments refer to points ``offsets_m`` away from the stated ones."""
    evidence: dict[str, list[PlateEvidence]] = {}
    for person, (geometric, wrench, forces, mass_kg) in enumerate(walks()[:people]):
        read_nm = wrench.moment_nm - sum(np.cross(o, f) for o, f in zip(offsets_m, forces, strict=True))
        one = plate_evidence(geometric, replace(wrench, moment_nm=read_nm), forces, mass_kg)
        assert one is not None
        evidence[f"person {person}"] = [one]
    return plate_references(evidence)


def test_offsets_are_estimated_and_named() -> None:
    """The people err, too, so what is added to them is compared with what they show without it."""
    plain, moved = identified(np.zeros((2, 3))), identified(OFFSETS_M)
    assert plain is not None
    assert moved is not None
    relative = OFFSETS_M[:, :2] - OFFSETS_M[:, :2].mean(axis=0)
    np.testing.assert_allclose(moved.horizontal_m - plain.horizontal_m, relative, atol=1e-6)
    assert moved.height_m - plain.height_m == pytest.approx(-0.06, abs=1e-6)
    assert np.abs(plain.horizontal_m).max() < 0.004
    assert moved.displaced_plates == (0, 1)
    assert moved.people == PEOPLE


def test_plates_that_are_where_they_are_stated_are_not_named() -> None:
    plain = identified(np.zeros((2, 3)))
    assert plain is not None
    assert plain.displaced_plates == ()
    assert not plain.is_high


def test_few_people_show_nothing() -> None:
    assert identified(OFFSETS_M, FEWEST_PEOPLE - 1) is None


def test_a_single_plate_shows_nothing() -> None:
    geometric, wrench, forces, mass_kg = walks()[0]
    whole = np.array([forces.sum(axis=0), np.zeros_like(forces[0])])
    assert plate_evidence(geometric, wrench, whole, mass_kg) is None
