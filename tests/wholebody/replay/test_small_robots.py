"""Lengths and forces of the replay are those of robots of a person's size, and in proportion for small ones."""

import dataclasses

import pytest

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.robots.loader import load_robot
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.replay import stabiliser
from stridelab.wholebody.replay.dcm_feedback import size_share
from stridelab.wholebody.replay.hand_force_control import Grip
from stridelab.wholebody.replay.replay import replay_with_defaults
from stridelab.wholebody.replay.stabiliser import Stabiliser
from support.robots.humanoid import Humanoid, archive
from support.robots.scenario_bodies import com_height_m, one_normal, walk_of

SCALE = 0.3


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A humanoid of 0.3 of its lengths and of the cube of that of its mass."""
    folder = tmp_path_factory.mktemp("small")
    upload = folder / "upload"
    humanoid = Humanoid(scale=SCALE, mass_scale=SCALE**3, effort=150.0 * SCALE**4, velocity=15.0)
    upload.write_bytes(archive({"small.urdf": humanoid.urdf()}))
    assumed = rebuild_description(upload, "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed).robot


@pytest.mark.parametrize("name", ["talos", "hrp2", "g1"])
def test_robots_of_a_persons_size_have_the_settings_as_they_are(name: str) -> None:
    assert size_share(load_robot(name)) == 1.0


def test_settings_scale_with_the_powers_of_their_units() -> None:
    usual, scaled = Stabiliser(), Stabiliser().scaled_by(0.25)
    assert scaled.least_load_n == pytest.approx(usual.least_load_n / 64.0)
    assert usual.footing is not None
    assert scaled.footing is not None
    assert scaled.footing.loaded_n == pytest.approx(usual.footing.loaded_n / 64.0)
    assert scaled.footing.search_m_s == pytest.approx(usual.footing.search_m_s / 2.0)
    assert scaled.footing.settling_s == pytest.approx(usual.footing.settling_s / 2.0)
    assert scaled.footing.may_land == usual.footing.may_land
    assert scaled.capture.edge_m == pytest.approx(usual.capture.edge_m / 4.0)
    assert scaled.stepping.most_step_m == pytest.approx(usual.stepping.most_step_m / 4.0)
    powers = {"_m": 1.0, "_m_s": 0.5, "_s": 0.5, "_n": 3.0, "_n_s": 2.5, "_m_per_ns": -2.5}
    for field in dataclasses.fields(Grip):
        unit = next((u for u in sorted(powers, key=len, reverse=True) if field.name.endswith(u)), None)
        power = 0.0 if unit is None else powers[unit]
        assert getattr(Grip().scaled_by(0.25), field.name) == pytest.approx(getattr(Grip(), field.name) * 0.25**power)


def test_a_robot_of_one_kilogram_stays_on_its_plan(small: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the settings of large robots its soles never count as landed, search the ground and push it over."""
    assert small.mass_kg * 9.81 < 60.0
    assert size_share(small) < 0.6
    h = com_height_m(small)
    shapes = {
        name: EffectorShape("surface", small.effectors[name].contact_half_size_m, com_height_m=h)
        for name in ("left_foot", "right_foot")
    }
    sequence = sequence_of(walk_of(small, 1, 0.02, Timing(0.8, 0.8, 0.4)) | {"friction": 0.6}, shapes)
    first, last = (standing_com_m(sequence.phases[i].contacts, 0.98 * h, small.effectors) for i in (0, -1))
    plan = solve(CentroidalProblem(sequence, small.mass_kg, small.effectors, one_normal(small), first, last))
    motion = WholeBodyController().run(small, sequence, plan)
    replayed = replay_with_defaults(small, sequence, motion, lambda *_: None)
    assert replayed.completed
    assert replayed.com_error_max_m < 0.005
    monkeypatch.setattr(stabiliser, "size_share", lambda _: 1.0)
    assert not replay_with_defaults(small, sequence, motion, lambda *_: None).completed
