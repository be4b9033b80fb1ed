"""What a stream's process makes of messages, without the process."""

import json
import struct
from typing import Any, get_args

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import InvalidInput, StridelabError
from stridelab.schemas.streams import StreamConfiguration, StreamPriors
from stridelab.service.api.stream.estimators import smoother_priors
from stridelab.service.api.stream.messages import PACKED, TEXT, Parcel
from stridelab.service.api.stream.session import StreamSession
from support.service.streams import CONFIGURATION, MOTION, pack_samples, walk_samples

SAMPLE = {"time_s": 0.0, "geometry_m": [0, 0, 1], "force_n": [0, 0, 686.7], "moment_nm": [0, 0, 0]}
ROW = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 686.7, 0.0, 0.0, 0.0)
NAN = float("nan")
INFINITE = float("inf")


def session(**fields: Any) -> StreamSession:
    return StreamSession(StreamConfiguration.model_validate({**CONFIGURATION.model_dump(), **fields}))


def text(samples: Any) -> Parcel:
    return Parcel(TEXT, json.dumps({"samples": samples}).encode())


METHODS = get_args(StreamConfiguration.model_fields["method"].annotation)


@pytest.mark.parametrize("method", METHODS)
def test_blocks_and_single_samples_give_the_same_numbers(method: str) -> None:
    samples = [sample.model_dump() for sample in walk_samples(0.5)]
    whole = json.loads(session(method=method).answer_message(text(samples)).content)["samples"]
    piecewise = session(method=method)
    single = [json.loads(piecewise.answer_message(text([sample])).content)["samples"][0] for sample in samples]
    assert whole == single
    assert np.array([s["com_m"] for s in whole]) == pytest.approx(
        MOTION.com.at(np.array([s["time_s"] for s in samples])), abs=0.01
    )


def test_an_empty_message_has_an_empty_answer() -> None:
    assert json.loads(session().answer_message(text([])).content) == {"samples": []}
    answer = session(format="float32").answer_message(Parcel(PACKED, pack_samples(3.0)))
    assert (answer.content, answer.samples) == (pack_samples(3.0), 0)


def test_times_of_a_long_stream_keep_their_resolution() -> None:
    """A float32 alone resolves 8 ms after a day: the message's own time is what it counts from."""
    day = 86_400.0
    running = session(format="float32")
    for k in range(5):
        answer = running.answer_message(Parcel(PACKED, pack_samples(day + k / 1000, ROW)))
        assert answer.content[:8] == struct.pack("<d", day + k / 1000)


@pytest.mark.parametrize("cutoffs", ["auto", "thesis", (0.3, 2.0)])
def test_the_cutoffs_are_reported(cutoffs: Any) -> None:
    ready = session(cutoffs=cutoffs).ready
    known = {"auto": (0.2, 1.0), "thesis": (0.4, 4.0)}
    assert (ready.low_hz, ready.high_hz) == (known[cutoffs] if isinstance(cutoffs, str) else cutoffs)


def test_priors_decide_the_band_and_not_the_position() -> None:
    samples = [sample.model_dump() for sample in walk_samples(0.5)]
    plain, wide = (
        json.loads(session(priors=priors).answer_message(text(samples)).content)["samples"]
        for priors in ({}, {"geometry_m": (0.05, 0.05, 0.08)})
    )
    assert [s["com_m"] for s in plain] == [s["com_m"] for s in wide]
    assert plain[0]["sd_m"][2] == pytest.approx(0.02, rel=0.05)
    assert wide[0]["sd_m"][2] == pytest.approx(0.08, rel=0.05)


def test_the_smoother_uses_the_stated_errors() -> None:
    """By one pair of numbers each: L = L' / (2 pi f), and errors of force / mass as a force and a share of g."""
    stated = StreamPriors(
        marker_m=0.003,
        acceleration_m_s2=(0.03, 0.04, 0.0981),
        moment_nm=2.5,
        momentum_rate_nm_kg=(0.1, 0.3),
        step_hz=2.0,
        clock_s=0.007,
    )
    priors = smoother_priors(stated, 80.0)
    assert (priors.marker_m, priors.plate_moment_nm, priors.clock_s, priors.step_hz) == (0.003, 2.5, 0.007, 2.0)
    assert priors.plate_force_n == pytest.approx(80.0 * 0.05 / 2**0.5)
    assert priors.mass_share == pytest.approx(0.01, rel=1e-3)
    assert priors.momentum_m_s is not None
    momentum_nms = 80.0 * GRAVITY_M_S2 * np.array(priors.momentum_m_s)
    t = np.linspace(0.0, 1.0, 1000, endpoint=False)
    for hz, rate_nm, expected_nms in zip((1.0, 2.0), (8.0, 24.0), momentum_nms, strict=True):
        rate = np.sqrt(2.0) * rate_nm * np.cos(2 * np.pi * hz * t)
        momentum = np.cumsum(rate) * (t[1] - t[0])
        assert np.std(momentum) == pytest.approx(expected_nms, rel=1e-3)


def test_the_smoother_rejects_errors_that_the_filter_takes_for_motion() -> None:
    """A table off by 6 mm: both keep it, and only the smoother's velocity is free of the markers' noise."""
    samples = [sample.model_dump() for sample in walk_samples(3.0)]
    t = np.array([sample["time_s"] for sample in samples])
    true_m, true_m_s = MOTION.com.at(t), MOTION.com.at(t, 1)
    noise = np.random.default_rng(0).normal([0.006, 0.0, 0.0], 0.001, (len(t), 3))
    for sample, row in zip(samples, true_m + noise, strict=True):
        sample["geometry_m"] = row.tolist()
    off = {}
    for method in METHODS:
        estimates = json.loads(session(method=method).answer_message(text(samples)).content)["samples"][200:]
        position, velocity = (np.array([s[name] for s in estimates]) for name in ("com_m", "velocity_m_s"))
        band = np.array([s["sd_m"] for s in estimates])
        assert (np.abs(position - true_m[200:]) < 1.96 * band).mean() > 0.9, method
        off[method] = np.sqrt(np.mean((velocity - true_m_s[200:])[:, :2] ** 2))
    assert off["smoother"] < 0.5 * off["complementary"]


def test_the_direction_for_the_smoother_may_have_any_length() -> None:
    samples = [sample.model_dump() for sample in walk_samples(0.5)]
    unknown, along, longer, across = (
        json.loads(session(method="smoother", ahead=ahead).answer_message(text(samples)).content)["samples"][-1]
        for ahead in (None, (1.0, 0.0), (250.0, 0.0), (0.0, -2.0))
    )
    assert along == longer
    assert along["sd_m"] != unknown["sd_m"]
    assert along["sd_m"][1] < across["sd_m"][1], "less momentum about the walking axis than about the lateral one"


@pytest.mark.parametrize(
    ("options", "code", "where"),
    [
        ({"method": "smoother", "cutoffs": "thesis"}, "cutoffs-not-used", "cutoffs"),
        ({"method": "smoother", "cutoffs": (0.2, 1.0)}, "cutoffs-not-used", "cutoffs"),
        ({"method": "complementary", "ahead": (1.0, 0.0)}, "ahead-not-used", "ahead"),
    ],
)
def test_options_without_effect_are_refused(options: dict[str, Any], code: str, where: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        session(**options)
    assert refused.value.code == code
    assert [fault.where for fault in refused.value.faults] == [where]


BAD_SAMPLES: dict[str, tuple[Any, str, str]] = {
    "time stops": ([SAMPLE, SAMPLE], "time-not-increasing", "samples[1].time_s"),
    "time jumps back": ([{**SAMPLE, "time_s": 5}, {**SAMPLE, "time_s": 4}], "time-not-increasing", "samples[1].time_s"),
    "time jumps on": ([SAMPLE, {**SAMPLE, "time_s": 60}], "time-jump", "samples[1].time_s"),
    "no geometry": ([{**SAMPLE, "geometry_m": None}], "geometry-missing", "samples[0]"),
    "half a wrench": ([{**SAMPLE, "moment_nm": None}], "invalid-samples", "samples.0"),
    "two numbers": ([{**SAMPLE, "force_n": [0, 1]}], "invalid-samples", "samples.0.force_n.2"),
    "text": ([{**SAMPLE, "time_s": "now"}], "invalid-samples", "samples.0.time_s"),
    "true": ([{**SAMPLE, "time_s": True}], "invalid-samples", "samples.0.time_s"),
    "nan": ([{**SAMPLE, "time_s": NAN}], "invalid-samples", "samples.0.time_s"),
    "infinite": ([{**SAMPLE, "force_n": [0, 0, INFINITE]}], "invalid-samples", "samples.0.force_n.2"),
    "unknown field": ([{**SAMPLE, "mass": 1}], "invalid-samples", "samples.0.mass"),
    "no list": (3, "invalid-samples", "samples"),
    "all wrong": ([{}] * 1000, "invalid-samples", "samples.0.time_s"),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", BAD_SAMPLES)
def test_bad_samples_are_named(name: str, method: str) -> None:
    samples, code, where = BAD_SAMPLES[name]
    with pytest.raises(StridelabError) as refused:
        session(method=method).answer_message(text(samples))
    assert refused.value.code == code
    assert where in [fault.where for fault in refused.value.faults]
    assert len(refused.value.faults) <= 20


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[", b"3", b"{}", b'{"samples": [], "more": 1}', b"{" * 9999])
def test_an_invalid_message_is_refused(content: bytes) -> None:
    with pytest.raises(InvalidInput) as refused:
        session().answer_message(Parcel(TEXT, content))
    assert refused.value.code == "invalid-samples"


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "wrong-packing"),
        (pack_samples(0.0, ROW)[:-1], "wrong-packing"),
        (pack_samples(0.0, ROW) + b"\x00" * 4, "wrong-packing"),
        (struct.pack("<10f", *ROW), "wrong-packing"),
        (pack_samples(NAN, ROW), "not-finite"),
        (pack_samples(INFINITE, ROW), "not-finite"),
        (pack_samples(0.0, (*ROW[:3], NAN, *ROW[4:])), "not-finite"),
        (pack_samples(0.0, (*ROW[:4], INFINITE, *ROW[5:])), "not-finite"),
        (pack_samples(0.0, (*ROW[:4], NAN, NAN, NAN, *ROW[7:])), "force-without-moment"),
        (pack_samples(0.0, (0.0, NAN, NAN, NAN, *ROW[4:])), "geometry-missing"),
        (pack_samples(0.0, ROW, ROW), "time-not-increasing"),
        (struct.pack(">d20f", 1.0, *ROW, *ROW), "time-not-increasing"),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_wrong_packing_is_refused(content: bytes, code: str, method: str) -> None:
    with pytest.raises(StridelabError) as refused:
        session(format="float32", method=method).answer_message(Parcel(PACKED, content))
    assert refused.value.code == code


def test_every_message_has_the_documented_format() -> None:
    for form, parcel in (("json", Parcel(PACKED, pack_samples(0.0, ROW))), ("float32", text([SAMPLE]))):
        with pytest.raises(InvalidInput) as refused:
            session(format=form).answer_message(parcel)
        assert refused.value.code == "wrong-format"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("field", ["geometry_m", "force_n", "moment_nm"])
def test_huge_numbers_do_not_crash_the_session(field: str, method: str) -> None:
    """Whatever comes out, it is an answer or a refusal."""
    huge = [{**SAMPLE, "time_s": k / 100, field: [1e308, -1e308, 1e308 * (-1) ** k]} for k in range(20)]
    with pytest.raises(InvalidInput) as refused:
        session(method=method).answer_message(text(huge))
    assert refused.value.code == "not-finite"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("extreme", [1e-9, 1000.0])
def test_the_largest_and_smallest_errors_that_can_be_stated_give_a_finite_band(extreme: float, method: str) -> None:
    stated: dict[str, Any] = dict.fromkeys(("marker_m", "moment_nm", "clock_s"), extreme)
    stated["step_hz"] = max(0.1, min(extreme, 10))
    stated |= {"geometry_m": (extreme,) * 3, "acceleration_m_s2": (extreme,) * 3, "momentum_rate_nm_kg": (extreme,) * 2}
    samples = [sample.model_dump() for sample in walk_samples(1.0)]
    estimates = json.loads(session(method=method, priors=stated).answer_message(text(samples)).content)["samples"]
    assert np.isfinite([s["sd_m"] for s in estimates]).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_stream_goes_on_where_markers_or_plates_are_missing(method: str) -> None:
    samples = [sample.model_dump() for sample in walk_samples(2.0)]
    for sample in samples[120:160]:
        sample["geometry_m"] = None
    for sample in samples[220:260]:
        sample["force_n"] = sample["moment_nm"] = None
    estimates = json.loads(session(method=method).answer_message(text(samples)).content)["samples"]
    true_m = MOTION.com.at(np.array([sample["time_s"] for sample in samples]))
    assert np.abs(np.array([s["com_m"] for s in estimates]) - true_m).max() < 0.03
    assert estimates[159]["sd_m"][2] > estimates[119]["sd_m"][2]


def test_a_parcel_of_any_bytes_passes_through_json() -> None:
    parcel = Parcel(PACKED, bytes(range(256)), 7)
    assert Parcel.from_json(json.loads(json.dumps(parcel.to_json()))) == parcel
