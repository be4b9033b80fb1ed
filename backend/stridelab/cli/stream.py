"""``stridelab stream``: replay a recording in real time to the online estimation of a service."""

import csv
import json
import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median, quantiles
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import require_file, staged_files
from stridelab.cli.options import (
    AsJson,
    Cutoffs,
    EstimateRequest,
    Estimation,
    Latency,
    OnlineMethod,
    Preparation,
    Token,
    Walk,
    parse_numbers,
    with_groups,
)
from stridelab.cli.results import out, progress_bar, validate_options
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.streams import StreamConfiguration, StreamEstimate, StreamSample


@with_groups
def stream(
    *,
    walk: Walk,
    method: Annotated[OnlineMethod, typer.Option("--method", help="Online estimator.")] = "complementary",
    ahead: Annotated[str | None, typer.Option("--ahead", help="X,Y: direction of the walk; for the smoother.")] = None,
    latency: Latency = "apply",
    cutoffs: Cutoffs = "auto",
    preparation: Preparation,
    speed: Annotated[float, typer.Option("--speed", help="Replay speed, as a multiple of real time.")] = 1.0,
    block: Annotated[int, typer.Option("--block", help="Samples per message.")] = 1,
    packed: Annotated[bool, typer.Option("--packed", help="Packed float32 instead of JSON.")] = False,
    csv: Annotated[Path | None, typer.Option("--csv", help="Write the estimates to this file.")] = None,
    as_json: AsJson = False,
    server: Annotated[str, typer.Option("--server", help="URL of the service.")] = "http://127.0.0.1:8000",
    token: Token = None,
) -> None:
    """Replay a recording in real time to a service that estimates its centre of mass online."""
    request = EstimateRequest(walk, estimation=Estimation(latency=latency, cutoffs=cutoffs), preparation=preparation)
    replay = Replay(method=method, ahead=ahead, speed=speed, block=block, packed=packed, csv=csv)
    stream_samples(request, replay, as_json=as_json, server=server, token=token)


COLUMNS = ("time_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "sd_x_m", "sd_y_m", "sd_z_m")


@dataclass(frozen=True)
class Replay:
    """Options of the replay: online method, ``speed`` as a multiple of real time, ``block`` in samples per message."""

    method: str = "complementary"
    ahead: str | None = None
    speed: float = 1.0
    block: int = 1
    packed: bool = False
    csv: Path | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.speed < math.inf:
            raise InvalidInput(
                "option-invalid", "--speed is a positive number.", [Fault("--speed", f"got {self.speed:g}")]
            )
        if self.block < 1:
            raise InvalidInput(
                "option-invalid", "--block is at least one sample.", [Fault("--block", f"got {self.block}")]
            )


@dataclass(frozen=True)
class ReplayResult:
    """Estimates of a replayed recording, and the response time of each message."""

    method: str
    estimates: list[StreamEstimate]
    took_s: list[float]
    played_s: float

    def to_json(self) -> dict[str, Any]:
        """Summary of the replay as a JSON object."""
        last = self.estimates[-1]
        slow_s = quantiles(self.took_s, n=20, method="inclusive")[-1] if len(self.took_s) > 1 else self.took_s[0]
        return {
            "method": self.method,
            "samples": len(self.estimates),
            "played_s": round(self.played_s, 3),
            "answer_median_ms": round(1e3 * median(self.took_s), 3),
            "answer_95_percent_ms": round(1e3 * slow_s, 3),
            "answer_max_ms": round(1e3 * max(self.took_s), 3),
            "last": last.model_dump(mode="json"),
        }


def stream_samples(request: EstimateRequest, replay: Replay, *, as_json: bool, server: str, token: str | None) -> None:
    """Place the body's segments here, replay geometry and wrench to ``server``, and show the estimates."""
    from stridelab.cli.remote import translated_errors
    from stridelab.client import Client

    for path in request.files:
        require_file(path)
    configuration, samples = prepare_samples(request, replay)
    with translated_errors(server), Client(server, token) as lab, lab.stream_com(configuration) as opened:
        blocks = [samples[i : i + replay.block] for i in range(0, len(samples), replay.block)]
        estimates, took_s = [], []
        began = time.perf_counter()
        with progress_bar(request.file.name) as bar:
            for block in pace_blocks(blocks, replay.speed):
                at = time.perf_counter()
                estimates += opened.send(block)
                took_s.append(time.perf_counter() - at)
                com = estimates[-1].com_m
                bar(len(estimates) / len(samples), f"{com[0]:+.3f} {com[1]:+.3f} {com[2]:+.3f} m")
        played = ReplayResult(opened.ready.method, estimates, took_s, time.perf_counter() - began)
    if replay.csv is not None:
        write_csv(replay.csv, estimates)
    if as_json:
        out.print_json(json.dumps(played.to_json()))
    else:
        show_replay(played, replay)


def prepare_samples(request: EstimateRequest, replay: Replay) -> tuple[StreamConfiguration, list[StreamSample]]:
    """Configuration and samples as sent live: the CoM of the segment model and the wrench of each frame.

    Raises the errors of ``estimate-com`` for a recording that cannot be used.
    """
    from stridelab.pipelines.com_inputs import prepare_com_inputs
    from stridelab.schemas.tasks import EstimateComTask

    input_ = request.to_input(request.file.name, EstimateComInput)
    with (
        tempfile.TemporaryDirectory(prefix="stridelab-") as folder,
        progress_bar(request.file.name) as bar,
        staged_files(request, Path(folder)) as (recording, static),
    ):
        task = EstimateComTask(recording=recording, static=static, input=input_)
        inputs = prepare_com_inputs(task, Path(folder), bar, needs_force=True)
    geometric, wrench = inputs.geometric, inputs.wrench
    configuration = validate_options(
        StreamConfiguration,
        {
            "mass_kg": inputs.mass.mass_kg,
            "rate_hz": inputs.trial.recording.marker_rate_hz,
            "method": replay.method,
            "ahead": None if replay.ahead is None else parse_numbers("--ahead", replay.ahead, 2),
            "cutoffs": input_.cutoffs,
            "priors": {"geometry_m": geometric.sd_m},
            "format": "float32" if replay.packed else "json",
        },
    )
    rows = zip(
        geometric.time_s.tolist(),
        geometric.com_m.tolist(),
        wrench.force_n.tolist(),
        wrench.moment_nm.tolist(),
        wrench.complete.tolist(),
        strict=True,
    )
    samples = [
        StreamSample(
            time_s=t,
            geometry_m=_finite_triple(g),
            force_n=_finite_triple(f) if complete else None,
            moment_nm=_finite_triple(nu) if complete else None,
        )
        for t, g, f, nu, complete in rows
    ]
    first = next(i for i, sample in enumerate(samples) if sample.geometry_m is not None)
    return configuration, samples[first:]


def pace_blocks(blocks: Sequence[list[StreamSample]], speed: float) -> Iterator[list[StreamSample]]:
    """Yield each block at the time when its last sample would have been measured."""
    began, start_s = time.perf_counter(), blocks[0][0].time_s
    for block in blocks:
        left_s = (block[-1].time_s - start_s) / speed - (time.perf_counter() - began)
        if left_s > 0:
            time.sleep(left_s)
        yield block


def write_csv(path: Path, estimates: Sequence[StreamEstimate]) -> None:
    """One row per sample. Raises ``InvalidInput`` (``output-not-writable``)."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(COLUMNS)
            rows.writerows([e.time_s, *e.com_m, *e.velocity_m_s, *e.sd_m] for e in estimates)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InvalidInput(
            "output-not-writable", f"Cannot write to {path}: {reason}.", [Fault("--csv", reason)]
        ) from error


def show_replay(played: ReplayResult, replay: Replay) -> None:
    """Print the summary as a table."""
    figures, last = played.to_json(), played.estimates[-1]
    table = Table(show_header=False, box=None, pad_edge=False)
    answered = (
        f"median {figures['answer_median_ms']:.2f} ms, 95 % within {figures['answer_95_percent_ms']:.2f} ms, "
        f"longest {figures['answer_max_ms']:.2f} ms"
    )
    for name, value in (
        ("method", played.method),
        ("played", f"{figures['samples']} samples in {played.played_s:.2f} s, {replay.block} per message"),
        ("answered", answered),
        ("last position", " / ".join(f"{x:.3f}" for x in last.com_m) + " m (x / y / z)"),
        ("its band", " / ".join(f"{1e3 * x:.1f}" for x in last.sd_m) + " mm, one standard deviation"),
    ):
        table.add_row(f"[bold]{name}[/]", escape(value))
    out.print(table)
    if replay.csv is not None:
        out.print(f"[green]written[/] {escape(str(replay.csv))}")


def _finite_triple(triple: Sequence[float]) -> tuple[float, float, float] | None:
    x, y, z = triple
    return None if math.isnan(x + y + z) else (x, y, z)
