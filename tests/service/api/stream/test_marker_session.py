"""What the process of a stream of markers makes of frames, without the process."""

import json
from typing import Any

import numpy as np
import pytest

from stridelab.schemas.streams import MarkerStreamConfiguration, MarkerStreamTask
from stridelab.service.api.stream.marker_session import NEWEST, PICTURE_S, MarkerSession
from support.service.streams import frame, header, sample


def session(**fields: Any) -> MarkerSession:
    configuration = MarkerStreamConfiguration.model_validate(header(**fields))
    return MarkerSession(MarkerStreamTask(configuration=configuration))


def replies_to(running: MarkerSession, *frames: dict[str, Any]) -> list[dict[str, Any]]:
    return [json.loads(answer.content) for answer in running.answer_frames([json.dumps(f).encode() for f in frames])]


def test_of_queued_frames_only_the_newest_are_computed() -> None:
    """Every frame has its answer, in order; an overtaken one has no number."""
    running = session()
    replies_to(running, frame(0))
    replies = replies_to(running, *(frame(k) for k in range(1, 8)))
    assert [one["t_s"] for one in replies] == pytest.approx(sample().time_s[1:8])
    for one in replies[:-NEWEST]:
        assert (one["reason"], one["margin_reason"], one["com_m"], one["margin_m"]) == (
            "overtaken",
            "overtaken",
            None,
            None,
        )
    assert all(one["com_m"] is not None for one in replies[-NEWEST:])
    assert replies[-NEWEST]["bridged"]["frames_lost"] == 7 - NEWEST


def test_a_centre_of_pressure_is_as_good_as_a_moment() -> None:
    """M = cop x F, less the free moment about the vertical, which hardly moves the central axis."""
    by_moment, by_cop = session(), session()
    positions_m = []
    for k in range(180, 230):
        measured = frame(k)
        plates: list[dict[str, Any]] = []
        for plate in measured["plates"]:
            f, nu = np.array(plate["force_n"]), np.array(plate["moment_nm"])
            cop = None if f[2] < 20.0 else [-nu[1] / f[2], nu[0] / f[2], 0.0]
            plates.append({"force_n": plate["force_n"], "cop": cop})
        positions_m.append((replies_to(by_moment, measured)[0], replies_to(by_cop, frame(k, plates=plates))[0]))
    used = [pair for pair in positions_m if pair[0]["bridged"]["force"] is None]
    assert len(used) > 30
    for moment, pressure in used:
        assert pressure["bridged"]["force"] is None
        assert pressure["com_m"] == pytest.approx(moment["com_m"], abs=2e-3)


def test_pictures_are_sent_at_most_fifty_times_a_second() -> None:
    running = session()
    contents = [json.dumps({**frame(k), "t_s": k / 200.0}).encode() for k in range(21)]
    pictures = [answer.picture for content in contents for answer in running.answer_frames([content])]
    assert sum(map(bool, pictures)) == round(0.1 / PICTURE_S) + 1


def test_a_force_that_points_down_is_remarked() -> None:
    turned = [
        {"force_n": [-x for x in plate["force_n"]], "moment_nm": [-x for x in plate["moment_nm"]]}
        for plate in frame(210)["plates"]
    ]
    running = session()
    replies_to(running, *(frame(k) for k in range(200, 210)))
    assert replies_to(running, frame(210, plates=turned))[0]["bridged"]["force"] == "force-points-down"


@pytest.mark.parametrize("factor", [1e-3, 0.1, 100.0, 1e3])
def test_a_body_in_other_units_has_no_estimate(factor: float) -> None:
    running = session()
    wrong = [None if m is None else [factor * x for x in m] for m in frame(0)["markers"]]
    reply = replies_to(running, frame(0, markers=wrong))[0]
    assert (reply["com_m"], reply["reason"], reply["margin_reason"]) == (None, "size-implausible", "size-implausible")
    assert replies_to(running, frame(1))[0]["com_m"] is not None


@pytest.mark.parametrize("axis", ["+x", "-x", "+y", "-y", "-z"])
def test_a_body_that_never_stands_along_the_stated_axis_has_no_estimate(axis: str) -> None:
    running = session(up_axis=axis)
    assert replies_to(running, frame(0, markers=[None] * len(frame(0)["markers"])))[0]["com_m"] is None
    replies = [replies_to(running, frame(k))[0] for k in range(10, 200, 40)]
    assert {one["reason"] for one in replies} == {"axis-implausible"}
    for one in replies:
        assert one["margin_reason"] == "axis-implausible"
        assert all(one[name] is None for name in ("com_m", "xcom_m", "velocity_m_s", "margin_m", "height_m"))


def test_a_person_who_lay_before_standing_or_lies_down_later_is_estimated() -> None:
    """The sample turned by 90 degrees about x is a person who lies; the floor is where it was."""

    def lying_frame(k: int) -> dict[str, Any]:
        return frame(k, markers=[None if m is None else [m[0], m[2], 0.2 - m[1]] for m in frame(k)["markers"]])

    running = session()
    reasons = [replies_to(running, one)[0]["reason"] for one in (lying_frame(0), frame(1), lying_frame(2))]
    assert reasons == ["axis-implausible", None, None]


def test_a_marker_that_jumps_away_leaves_the_estimate() -> None:
    markers = frame(0)["markers"]
    assert replies_to(session(), frame(0, markers=[[x + 50.0 for x in markers[0]], *markers[1:]]))[0]["reason"] is None
