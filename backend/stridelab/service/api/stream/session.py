"""Session of a stream: feeds messages to an online estimator. Runs in the child process of the stream."""

import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float64
from pydantic import ValidationError

from stridelab.conventions import Vector3
from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.streams import (
    PACKED_ROW,
    PACKED_TIME,
    StreamAnswer,
    StreamConfiguration,
    StreamSamples,
)
from stridelab.service.api.stream.estimators import create_estimator
from stridelab.service.api.stream.messages import PACKED, TEXT, Parcel

_TIME_BYTES: Final = struct.calcsize(PACKED_TIME)
_ROW_BYTES: Final = struct.calcsize(PACKED_ROW)
_COLUMNS: Final = _ROW_BYTES // 4
_SHOWN_FAULTS: Final = 20
_LARGEST_FLOAT32: Final = float(np.finfo(np.float32).max)

Sample = tuple[float, Vector3 | None, Vector3 | None, Vector3 | None]
Rows = Float64[np.ndarray, "n 10"]
Estimates = Float64[np.ndarray, "n 9"]


class StreamSession:
    """Estimator of one stream. Raises ``InvalidInput`` for an inconsistent configuration."""

    def __init__(self, configuration: StreamConfiguration) -> None:
        self._format = configuration.format
        self._estimator, self.ready = create_estimator(configuration)

    def answer_message(self, parcel: Parcel) -> Parcel:
        """Compute the estimates for the samples of a message.

        Raises ``InvalidInput`` or ``NotEstimable``, naming the sample by its index in the message.
        """
        if (parcel.kind == PACKED) != (self._format == "float32"):
            kind = "packed" if parcel.kind == PACKED else "text"
            raise InvalidInput("wrong-format", f"Received a {kind} message on a stream of format {self._format}.")
        if self._format == "json":
            samples = parse_text(parcel.content)
            estimates = [
                {"time_s": sample[0], "com_m": row[0:3], "velocity_m_s": row[3:6], "sd_m": row[6:9]}
                for sample, row in zip(samples, self._estimate_rows(samples).tolist(), strict=True)
            ]
            text = json.dumps({"samples": estimates}, allow_nan=False)
            return Parcel(TEXT, text.encode(), len(samples))
        start_s, rows = parse_packed(parcel.content)
        samples = [_unpack_sample(start_s, row) for row in rows]
        answers = np.empty((len(rows), _COLUMNS), dtype="<f4")
        answers[:, 0] = rows[:, 0]
        answers[:, 1:] = self._estimate_rows(samples, largest=_LARGEST_FLOAT32)
        return Parcel(PACKED, struct.pack(PACKED_TIME, start_s) + answers.tobytes(), len(rows))

    def _estimate_rows(self, samples: list[Sample], largest: float = np.inf) -> Estimates:
        """CoM, velocity and standard deviation, one row per sample.

        Raises ``InvalidInput`` (``not-finite``) if numbers overflow.
        """
        rows = np.empty((len(samples), 9))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # the result is checked below
            for index, sample in enumerate(samples):
                rows[index] = self._estimate_sample(index, sample)
        if not (np.abs(rows) < largest).all():
            raise _too_large()
        return rows

    def _estimate_sample(self, index: int, sample: Sample) -> Float64[np.ndarray, "9"]:
        try:
            return np.concatenate(self._estimator.step(*sample))
        except StridelabError as error:
            where = f"samples[{index}]"
            faults = [Fault(f"{where}.{fault.where}", fault.message) for fault in error.faults]
            raise type(error)(error.code, error.message, faults or [Fault(where, error.message)]) from error
        except np.linalg.LinAlgError as error:
            raise _too_large() from error


class StreamAnswerer:
    """The work of a stream's child: its first task is the configuration, every other one a message."""

    def __init__(self) -> None:
        self._session: StreamSession | None = None

    def __call__(self, task: dict[str, Any], _folder: Path | None, _progress: ProgressCallback) -> dict[str, Any]:
        """Answer ``task``, a ``Parcel`` as JSON. Raises as ``StreamSession``."""
        parcel = Parcel.from_json(task)
        if self._session is not None:
            return self._session.answer_message(parcel).to_json()
        self._session = StreamSession(StreamConfiguration.model_validate_json(parcel.content))
        ready = StreamAnswer(ready=self._session.ready).model_dump_json(exclude_none=True)
        return Parcel(TEXT, ready.encode()).to_json()


def _too_large() -> InvalidInput:
    return InvalidInput("not-finite", "The numbers in the samples are too large for an estimate.")


def parse_text(content: bytes) -> list[Sample]:
    """Parse the samples of a JSON message. Raises ``InvalidInput`` (``invalid-samples``) with the faulty fields."""
    try:
        message = StreamSamples.model_validate_json(content, strict=True)
    except ValidationError as error:
        faults = [
            Fault(".".join(str(part) for part in item["loc"])[:100] or "message", item["msg"][:200])
            for item in error.errors(include_url=False, include_input=False, include_context=False)[:_SHOWN_FAULTS]
        ]
        raise InvalidInput(
            "invalid-samples", 'A text message must have the form {"samples": [{"time_s": ...}, ...]}.', faults
        ) from error
    return [
        (sample.time_s, _to_array(sample.geometry_m), _to_array(sample.force_n), _to_array(sample.moment_nm))
        for sample in message.samples
    ]


def parse_packed(content: bytes) -> tuple[float, Rows]:
    """Parse time and rows of a packed message. Raises ``InvalidInput`` (``wrong-packing``) for an invalid length."""
    if len(content) < _TIME_BYTES or (len(content) - _TIME_BYTES) % _ROW_BYTES:
        raise InvalidInput(
            "wrong-packing",
            f"A packed message has {_TIME_BYTES} bytes and {_ROW_BYTES} more per sample; this one has {len(content)}.",
        )
    (start_s,) = struct.unpack_from(PACKED_TIME, content)
    rows = np.frombuffer(content, dtype="<f4", offset=_TIME_BYTES).reshape(-1, _COLUMNS)
    return float(start_s), rows.astype(np.float64)


def _unpack_sample(start_s: float, row: Float64[np.ndarray, "10"]) -> Sample:
    return start_s + float(row[0]), _none_if_missing(row[1:4]), _none_if_missing(row[4:7]), _none_if_missing(row[7:10])


def _none_if_missing(triple: Vector3) -> Vector3 | None:
    return None if np.isnan(triple).all() else triple


def _to_array(triple: tuple[float, float, float] | None) -> Vector3 | None:
    return None if triple is None else np.array(triple)
