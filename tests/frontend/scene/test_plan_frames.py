"""Frames of a plan are the numbers of its files, and what is there for a while is there in its phases."""

import asyncio
import gzip
from collections.abc import Callable

import httpx
import numpy as np
import pytest

from stridelab_web.scene.body_frames import PERSON, profile_of
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.scene.documents import Document
from stridelab_web.scene.frame_cache import MAX_PLANS, FrameCache
from stridelab_web.scene.frames import ARROW_M_PER_N
from stridelab_web.scene.plan_frames import (
    COM,
    GROUP,
    MOMENTUM,
    MOMENTUM_M_PER_NMS,
    com_m,
    friction_cones,
    plan_frames,
    read_motion,
)
from stridelab_web.scene.result_files import read_plan
from stridelab_web.viewer import meshes
from support.browser.page import read_frames
from support.fakes import robots
from support.fakes.service import FakeService
from support.fakes.web_app import make_client

SCENARIO = robots.scenario()


def test_every_link_and_force_is_as_in_its_file() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO))
    poses, forces = robots.poses(SCENARIO), robots.forces(SCENARIO)
    assert [body.name for body in frames.bodies] == [f"/robot/{link}" for link in robots.LINKS]
    for k, body in enumerate(frames.bodies):
        np.testing.assert_array_equal(frames.values[:, body.at : body.at + 7], poses[:, k])
    momentum, *arrows = frames.arrows
    assert momentum.shaft.startswith(MOMENTUM)
    assert [arrow.label for arrow in arrows] == [f"force on {name}" for name in robots.EFFECTORS]
    for k, arrow in enumerate(arrows):
        np.testing.assert_array_equal(frames.values[:, arrow.at : arrow.at + 6], forces[:, k])


def test_centre_of_mass_follows_the_constant_acceleration_between_the_nodes() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO))
    t = frames.time_s
    half = robots.duration_s(SCENARIO) / 2
    a = 0.04
    expected = np.where(t <= half, a * t**2 / 2, a * half**2 - a * (2 * half - t) ** 2 / 2)
    shown = frames.track_m("/paths/com")
    assert shown is not None
    assert np.abs(shown[:, 0] - expected).max() < 1e-6
    assert np.abs(shown[:, 2] - 0.88).max() < 1e-6
    assert frames.points[0].name == COM


def test_centre_of_mass_needs_its_columns() -> None:
    columns = robots.centroidal(SCENARIO)
    del columns["com_az_m_s2"]
    with pytest.raises(ValueError, match="centre of mass"):
        com_m(columns, np.array([0.0]))


def test_the_momentum_stands_at_the_centre_of_mass_in_metres_per_newton_metre_second() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO))
    arrow = frames.arrows[0]
    assert arrow.at == frames.points[0].at
    shown_m = ARROW_M_PER_N * frames.values[:, arrow.at + 3 : arrow.at + 6]
    assert np.allclose(shown_m[:, 1], MOMENTUM_M_PER_NMS * np.sin(frames.time_s), atol=1e-4)
    assert not shown_m[:, [0, 2]].any()


def test_the_momentum_is_that_of_the_motion_where_there_is_one() -> None:
    columns = robots.centroidal(SCENARIO)
    motion = {"time_s": columns["time_s"], **{f"l_{axis}_nms": columns["time_s"] for axis in "xyz"}}
    frames = plan_frames(SCENARIO, columns, None, motion)
    assert np.allclose(ARROW_M_PER_N * frames.values[:, 3], MOMENTUM_M_PER_NMS * frames.time_s, atol=1e-5)
    bare = {name: values for name, values in columns.items() if not name.startswith("l_")}
    assert len(plan_frames(SCENARIO, bare, None).arrows) == len(robots.EFFECTORS)


def test_the_person_has_limbs_between_the_joints_that_are_known_while_recorded() -> None:
    columns = robots.centroidal(SCENARIO)
    times_s = columns["time_s"]
    track = {
        f"{name}_{axis}_m": 0.1 * k + times_s[1:4]
        for k, name in enumerate(("com", "l_hip", "l_knee", "l_ankle"))
        for axis in "xyz"
    }
    track |= {f"r_{name}_{axis}_m": np.full(3, np.nan) for name in ("hip", "knee") for axis in "xyz"}
    frames = plan_frames(SCENARIO, columns, None, None, {"time_s": times_s[1:4], **track})
    starts = {stick.name: (stick.start, stick.end) for stick in frames.sticks}
    assert list(starts) == [f"{PERSON}thigh/l", f"{PERSON}shank/l"]
    assert all(profile_of(stick) for stick in frames.sticks)
    thigh = frames.values[:, list(starts[f"{PERSON}thigh/l"])]
    assert np.allclose(thigh[1:4], np.column_stack([0.1 + times_s[1:4], 0.2 + times_s[1:4]]), atol=1e-4)
    assert np.isnan(thigh[[0, 4]]).all()
    assert f"{PERSON}com" in [point.name for point in frames.points]
    assert not plan_frames(SCENARIO, columns, None).sticks


def test_a_cone_stands_where_the_force_acts_while_its_contact_is_loaded() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO))
    at = {arrow.label: arrow.at for arrow in frames.arrows}
    shown = {point.name: point.at for point in frames.points if point.name.startswith(GROUP)}
    placed = placed_contacts(SCENARIO)
    assert shown == {f"{GROUP}{touch.number}": at[f"force on {touch.effector}"] for touch in placed}
    spans = {span.name: (span.start_s, span.end_s) for span in frames.spans}
    assert {spans[f"{GROUP}{touch.number}"] == (touch.start_s, touch.end_s) for touch in placed} == {True}
    without = {k: v for k, v in robots.centroidal(SCENARIO).items() if not k.startswith("friction_")}
    assert friction_cones(SCENARIO, without) == ()
    coned = plan_frames(SCENARIO, robots.centroidal(SCENARIO), None)
    assert plan_frames(SCENARIO, without, None).values.shape == coned.values.shape, "cones need no numbers of their own"


def test_a_cone_is_as_wide_as_its_friction() -> None:
    result = friction_cones(SCENARIO, robots.centroidal(SCENARIO))
    assert {cone.touch.effector: cone.friction for cone in result} == robots.FRICTION
    vertices, faces = meshes.open_cone(0.5, 0.4)
    assert np.hypot(*vertices[: meshes.RIM_STEPS, :2].T) == pytest.approx(0.5 * 0.4)
    assert vertices[: meshes.RIM_STEPS, 2] == pytest.approx(0.4)
    assert not vertices[meshes.RIM_STEPS].any()
    assert faces.max() < len(vertices)


def test_a_contact_is_there_in_its_phases() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO))
    spans = {span.name: (span.start_s, span.end_s) for span in frames.spans}
    assert spans["/contacts/1/touching"] == pytest.approx((0.0, 2.0))  # the left foot at the start: phases 0 to 2
    assert spans["/contacts/3/touching"] == pytest.approx((1.0, 5.8))  # the hand, once for all
    assert spans["/contacts/5/touching"] == pytest.approx((2.8, 4.0))
    assert len([name for name in spans if name.startswith("/contacts/")]) == 7
    assert frames.phase_starts_s == pytest.approx((0.0, 1.0, 1.8, 2.0, 2.8, 3.0, 3.8, 4.0, 4.8))


def test_without_a_whole_body_forces_are_drawn_from_the_middle_of_the_patch() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO, whole_body=False))
    assert frames.bodies == ()
    at = {arrow.label: arrow.at for arrow in frames.arrows}
    right = frames.values[:, at["force on right_foot"] : at["force on right_foot"] + 6]
    k = int(np.argmin(np.abs(frames.time_s - 1.9)))
    assert right[k] == pytest.approx((0.3, -0.09, 0.1, 0.0, 0.0, 400.0))  # four corners of 100 N
    assert np.isnan(right[int(np.argmin(np.abs(frames.time_s - 1.5)))]).all()


def test_a_file_of_another_size_is_refused() -> None:
    files = robots.plan_files(SCENARIO)
    with pytest.raises(ValueError):
        read_motion(files["poses.json"], files["poses.f32"][:-4], files["forces.f32"])


def test_browser_gets_the_poses_of_the_file(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    job = fake.add_plan()
    layout, values = read_frames(browse(f"/view/scene/plan/{job.id}/-/frames.bin").content)
    at = dict(layout["bodies"])["/robot/leg_right_6_link"]
    expected = robots.poses(SCENARIO)[:, robots.LINKS.index("leg_right_6_link")]
    np.testing.assert_allclose(values[:, at : at + 3], expected[:, :3], rtol=0, atol=1e-5)
    sign = np.sign(np.einsum("ij,ij->i", values[:, at + 3 : at + 7], expected[:, 3:]))
    np.testing.assert_allclose(sign[:, None] * values[:, at + 3 : at + 7], expected[:, 3:], rtol=0, atol=1e-5)
    assert browse("/view/scene/film/x/-/frames.bin").status_code == 404
    assert browse("/view/scene/scenario/x/-/frames.bin").status_code == 404


def test_frames_of_a_plan_are_packed_once(fake: FakeService) -> None:
    """One app for all requests, since the cache is the app's."""
    web, job = make_client(fake), fake.add_plan()
    address = f"/view/scene/plan/{job.id}/-/frames.bin"
    first = web.get(address).content
    stored: FrameCache = web.app.state.packed  # type: ignore[attr-defined]
    stored.store_frames(Document("plan", job.id), gzip.compress(b"kept"))
    assert len(first) > 100
    assert web.get(address).content == b"kept"


def test_frames_that_were_requested_last_are_cached_for_those_who_may_see_the_plan() -> None:
    stored, documents = FrameCache(), [Document("plan", str(k)) for k in range(MAX_PLANS + 1)]
    for document in documents:
        stored.store_frames(document, document.id.encode())

    class Lab:
        async def result(self, job_id: str) -> None:
            """The last plan is gone."""
            if job_id == str(MAX_PLANS):
                raise LookupError(job_id)

    async def found(document: Document) -> bytes | None:
        return await stored.cached_frames(Lab(), document)  # type: ignore[arg-type]

    there = [asyncio.run(found(document)) for document in documents[:-1]]
    assert there == [None, *(document.id.encode() for document in documents[1:-1])]
    with pytest.raises(LookupError):
        asyncio.run(found(documents[-1]))


def test_what_is_drawn_twice_is_sent_once() -> None:
    _, frames = read_plan(robots.plan_files(SCENARIO, replay=True))
    copied = {copy.name: copy for copy in frames.copies}
    for link in robots.LINKS:
        assert copied[f"/ghost/{link}"].of == f"/robot/{link}"
        assert copied[f"/ghost/{link}"].paint is not None
    cones_and_places = {name: copy.of for name, copy in copied.items() if not name.startswith("/ghost/")}
    # touches 1 and 5 are the left foot's, 2, 4 and 6 the right one's, 3 the hand's, whose density turns with the soles
    assert cones_and_places["/cones/4"] == "/cones/2"
    assert cones_and_places["/reach/4/0"] == "/reach/2/0"
    assert cones_and_places["/reach/3/1"] == "/reach/3/0"
    assert {"/cones/1", "/cones/2", "/cones/3", "/reach/1/0", "/reach/2/0", "/reach/3/0"}.isdisjoint(copied)
    assert not set(cones_and_places.values()) & set(copied), "no copy of a copy"
