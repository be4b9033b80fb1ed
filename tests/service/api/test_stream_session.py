"""What a stream's process makes of messages, without the process."""

import json
import struct
from typing import Any

import numpy as np
import pytest

from stridelab.errors import InvalidInput, StridelabError
from stridelab.schemas.streams import StreamConfiguration
from stridelab.service.api.stream.session import Session
from stridelab.service.api.stream.wire import HEADER, PACKED, TEXT, Parcel
from support.streams import CONFIGURATION, MOTION, packed, walk_samples

SAMPLE = {"time_s": 0.0, "geometry_m": [0, 0, 1], "force_n": [0, 0, 686.7], "moment_nm": [0, 0, 0]}
ROW = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 686.7, 0.0, 0.0, 0.0)
NAN = float("nan")
INFINITE = float("inf")


def session(**fields: Any) -> Session:
    return Session(StreamConfiguration.model_validate({**CONFIGURATION.model_dump(), **fields}))


def text(samples: Any) -> Parcel:
    return Parcel(TEXT, json.dumps({"samples": samples}).encode())


def test_blocks_and_single_samples_give_the_same_numbers() -> None:
    samples = [sample.model_dump() for sample in walk_samples(0.5)]
    whole = json.loads(session().answer(text(samples)).content)["samples"]
    piecewise = session()
    single = [json.loads(piecewise.answer(text([sample])).content)["samples"][0] for sample in samples]
    assert whole == single
    assert np.array([s["com_m"] for s in whole]) == pytest.approx(
        MOTION.com.at(np.array([s["time_s"] for s in samples])), abs=0.01
    )


def test_an_empty_message_has_an_empty_answer() -> None:
    assert json.loads(session().answer(text([])).content) == {"samples": []}
    answer = session(format="float32").answer(Parcel(PACKED, packed(3.0)))
    assert (answer.content, answer.samples) == (packed(3.0), 0)


def test_times_of_a_long_stream_keep_their_resolution() -> None:
    """A float32 alone resolves 8 ms after a day: the message's own time is what it counts from."""
    day = 86_400.0
    running = session(format="float32")
    for k in range(5):
        answer = running.answer(Parcel(PACKED, packed(day + k / 1000, ROW)))
        assert answer.content[:8] == struct.pack("<d", day + k / 1000)


@pytest.mark.parametrize("cutoffs", ["auto", "thesis", (0.3, 2.0)])
def test_the_cutoffs_are_told(cutoffs: Any) -> None:
    ready = session(cutoffs=cutoffs).ready
    known = {"auto": (0.2, 1.0), "thesis": (0.4, 4.0)}
    assert (ready.low_hz, ready.high_hz) == (known[cutoffs] if isinstance(cutoffs, str) else cutoffs)


def test_priors_decide_the_band_and_not_the_position() -> None:
    samples = [sample.model_dump() for sample in walk_samples(0.5)]
    plain, wide = (
        json.loads(session(priors=priors).answer(text(samples)).content)["samples"]
        for priors in ({}, {"geometry_m": (0.05, 0.05, 0.08)})
    )
    assert [s["com_m"] for s in plain] == [s["com_m"] for s in wide]
    assert plain[0]["sd_m"][2] == pytest.approx(0.02, rel=0.05)
    assert wide[0]["sd_m"][2] == pytest.approx(0.08, rel=0.05)


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


@pytest.mark.parametrize("name", BAD_SAMPLES)
def test_bad_samples_are_named(name: str) -> None:
    samples, code, where = BAD_SAMPLES[name]
    with pytest.raises(StridelabError) as refused:
        session().answer(text(samples))
    assert refused.value.code == code
    assert where in [fault.where for fault in refused.value.faults]
    assert len(refused.value.faults) <= 20


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[", b"3", b"{}", b'{"samples": [], "more": 1}', b"{" * 9999])
def test_what_is_no_message_is_refused(content: bytes) -> None:
    with pytest.raises(InvalidInput) as refused:
        session().answer(Parcel(TEXT, content))
    assert refused.value.code == "invalid-samples"


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "wrong-packing"),
        (packed(0.0, ROW)[:-1], "wrong-packing"),
        (packed(0.0, ROW) + b"\x00" * 4, "wrong-packing"),
        (struct.pack("<10f", *ROW), "wrong-packing"),
        (packed(NAN, ROW), "not-finite"),
        (packed(INFINITE, ROW), "not-finite"),
        (packed(0.0, (*ROW[:3], NAN, *ROW[4:])), "not-finite"),
        (packed(0.0, (*ROW[:4], INFINITE, *ROW[5:])), "not-finite"),
        (packed(0.0, (*ROW[:4], NAN, NAN, NAN, *ROW[7:])), "force-without-moment"),
        (packed(0.0, (0.0, NAN, NAN, NAN, *ROW[4:])), "geometry-missing"),
        (packed(0.0, ROW, ROW), "time-not-increasing"),
        (struct.pack(">d20f", 1.0, *ROW, *ROW), "time-not-increasing"),
    ],
)
def test_wrong_packing_is_refused(content: bytes, code: str) -> None:
    with pytest.raises(StridelabError) as refused:
        session(format="float32").answer(Parcel(PACKED, content))
    assert refused.value.code == code


def test_the_format_is_kept_to() -> None:
    for form, parcel in (("json", Parcel(PACKED, packed(0.0, ROW))), ("float32", text([SAMPLE]))):
        with pytest.raises(InvalidInput) as refused:
            session(format=form).answer(parcel)
        assert refused.value.code == "wrong-format"


def test_huge_numbers_are_no_crash() -> None:
    """Whatever comes out, it is an answer or a refusal."""
    huge = [{**SAMPLE, "time_s": k / 100, "geometry_m": [1e300, -1e300, 1e300 * (-1) ** k]} for k in range(20)]
    with pytest.raises(InvalidInput) as refused:
        session().answer(text(huge))
    assert refused.value.code == "not-finite"


def test_a_parcel_says_how_long_it_is() -> None:
    raw = Parcel(TEXT, b"abc", 7).to_bytes()
    assert HEADER.unpack(raw[: HEADER.size]) == (TEXT, 7, 3)
    assert raw[HEADER.size :] == b"abc"
