"""``stridelab stream``: replay a recording in real time to the online estimation of a service."""

import csv
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median, quantiles
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from rich.markup import escape

from stridelab.cli.estimate import staged_files
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
from stridelab.cli.results import out, progress_bar, show_rows
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.streams import (
    FrameEstimate,
    MarkerFrame,
    MarkerPerson,
    MarkerPlate,
    MarkerStreamConfiguration,
    PlateForce,
    StreamConfiguration,
    StreamEstimate,
    StreamSample,
)
from stridelab.service.local_runs import require_file, validate_options

if TYPE_CHECKING:
    from stridelab.pipelines.com_inputs import ComInputs
    from stridelab.schemas.tasks import EstimateComTask

Item = TypeVar("Item")
Answer = TypeVar("Answer")


@with_groups
def stream(
    *,
    walk: Walk,
    markers: Annotated[
        bool, typer.Option("--markers", help="Send markers and plates; the service computes CoM, XCoM and margins.")
    ] = False,
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
    if markers:
        stream_frames(request, replay, as_json=as_json, server=server, token=token)
    else:
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
        return {"method": self.method, **_summary(self.estimates, self.took_s, self.played_s)}


def _summary(
    estimates: Sequence[StreamEstimate] | Sequence[FrameEstimate], took_s: Sequence[float], played_s: float
) -> dict[str, Any]:
    """Number of samples, response times, and the last estimate."""
    slow_s = quantiles(took_s, n=20, method="inclusive")[-1] if len(took_s) > 1 else took_s[0]
    return {
        "samples": len(estimates),
        "played_s": round(played_s, 3),
        "answer_median_ms": round(1e3 * median(took_s), 3),
        "answer_95_percent_ms": round(1e3 * slow_s, 3),
        "answer_max_ms": round(1e3 * max(took_s), 3),
        "last": estimates[-1].model_dump(mode="json"),
    }


def _describe_times(figures: Mapping[str, Any]) -> str:
    return (
        f"median {figures['answer_median_ms']:.2f} ms, 95 % within {figures['answer_95_percent_ms']:.2f} ms, "
        f"longest {figures['answer_max_ms']:.2f} ms"
    )


def stream_samples(request: EstimateRequest, replay: Replay, *, as_json: bool, server: str, token: str | None) -> None:
    """Place the body's segments here, replay geometry and wrench to ``server``, and show the estimates."""
    from stridelab.cli.remote import translated_errors
    from stridelab.client import Client

    for path in request.files:
        require_file(path)
    configuration, samples = prepare_samples(request, replay)
    with translated_errors(server), Client(server, token) as lab, lab.stream_com(configuration) as opened:
        blocks = [samples[i : i + replay.block] for i in range(0, len(samples), replay.block)]
        paced = pace_blocks(blocks, replay.speed)
        answers, took_s, played_s = _send_paced(request.file.name, paced, len(blocks), opened.send, _describe_position)
    estimates = [estimate for answer in answers for estimate in answer]
    played = ReplayResult(opened.ready.method, estimates, took_s, played_s)
    if replay.csv is not None:
        write_csv(replay.csv, [[e.time_s, *e.com_m, *e.velocity_m_s, *e.sd_m] for e in estimates])
    if as_json:
        out.print_json(json.dumps(played.to_json()))
    else:
        show_replay(played, replay)


def _read_inputs(request: EstimateRequest, *, needs_force: bool) -> "tuple[EstimateComTask, ComInputs]":
    """The task of ``estimate-com`` on the recording, and its inputs."""
    from stridelab.pipelines.com_inputs import prepare_com_inputs
    from stridelab.schemas.tasks import EstimateComTask

    input_ = request.to_input(request.file.name, EstimateComInput)
    with (
        tempfile.TemporaryDirectory(prefix="stridelab-") as folder,
        progress_bar(request.file.name) as bar,
        staged_files(request, Path(folder)) as (recording, static),
    ):
        task = EstimateComTask(recording=recording, static=static, input=input_)
        return task, prepare_com_inputs(task, Path(folder), bar, needs_force=needs_force)


def prepare_samples(request: EstimateRequest, replay: Replay) -> tuple[StreamConfiguration, list[StreamSample]]:
    """Configuration and samples as sent live: the CoM of the segment model and the wrench of each frame.

    Raises the errors of ``estimate-com`` for a recording that cannot be used.
    """
    task, inputs = _read_inputs(request, needs_force=True)
    geometric, wrench = inputs.geometric, inputs.wrench
    configuration = validate_options(
        StreamConfiguration,
        {
            "mass_kg": inputs.mass.mass_kg,
            "rate_hz": inputs.trial.recording.marker_rate_hz,
            "method": replay.method,
            "ahead": None if replay.ahead is None else parse_numbers("--ahead", replay.ahead, 2),
            "cutoffs": task.input.cutoffs,
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
    return _pace(blocks, [block[-1].time_s - blocks[0][0].time_s for block in blocks], speed)


def _pace(items: Sequence[Item], due_s: Sequence[float], speed: float) -> Iterator[Item]:
    began = time.perf_counter()
    for item, at_s in zip(items, due_s, strict=True):
        left_s = at_s / speed - (time.perf_counter() - began)
        if left_s > 0:
            time.sleep(left_s)
        yield item


def _send_paced(
    title: str, paced: Iterable[Item], count: int, send: Callable[[Item], Answer], describe: Callable[[Answer], str]
) -> tuple[list[Answer], list[float], float]:
    """Send items as they come; returns the answers, the time of each, and the time of all, in seconds."""
    answers, took_s = [], []
    began = time.perf_counter()
    with progress_bar(title) as bar:
        for item in paced:
            at = time.perf_counter()
            answers.append(send(item))
            took_s.append(time.perf_counter() - at)
            bar(len(answers) / count, describe(answers[-1]))
    return answers, took_s, time.perf_counter() - began


def _describe_position(estimates: Sequence[StreamEstimate]) -> str:
    x, y, z = estimates[-1].com_m
    return f"{x:+.3f} {y:+.3f} {z:+.3f} m"


def _show_figures(rows: Iterable[tuple[str, str]], csv_file: Path | None) -> None:
    show_rows(rows)
    if csv_file is not None:
        out.print(f"[green]written[/] {escape(str(csv_file))}")


def stream_frames(request: EstimateRequest, replay: Replay, *, as_json: bool, server: str, token: str | None) -> None:
    """Replay markers and plates to ``server``, which places the segments, and show what it answers."""
    from stridelab.cli.remote import translated_errors
    from stridelab.client import Client

    unused = {"--method": replay.method != "complementary", "--ahead": replay.ahead is not None,
              "--cutoffs": request.estimation.cutoffs != "auto", "--block": replay.block != 1,
              "--packed": replay.packed}  # fmt: skip
    for option in (name for name, is_given in unused.items() if is_given):
        raise InvalidInput("option-invalid", f"{option} is not for --markers.", [Fault(option, "not used")])
    for path in request.files:
        require_file(path)
    header, frames = prepare_frames(request)
    with translated_errors(server), Client(server, token) as lab, lab.stream_markers(header) as opened:
        for remark in () if as_json else opened.ready.remarks:
            out.print(f"[yellow]{escape(remark.message)}[/]")
        paced = _pace(frames, [frame.t_s - frames[0].t_s for frame in frames], replay.speed)
        estimates, took_s, played_s = _send_paced(request.file.name, paced, len(frames), opened.send, _describe_margin)
    if replay.csv is not None:
        write_csv(replay.csv, [_frame_row(estimate) for estimate in estimates], FRAME_COLUMNS)
    figures = {"marker_set": opened.ready.marker_set, **_summary(estimates, took_s, played_s)}
    figures["without_estimate"] = sum(estimate.com_m is None for estimate in estimates)
    figures["without_force"] = sum(estimate.bridged.force is not None for estimate in estimates)
    if as_json:
        out.print_json(json.dumps(figures))
        return
    rows = (
        ("marker set", opened.ready.marker_set),
        ("played", f"{len(frames)} frames in {played_s:.2f} s"),
        ("answered", _describe_times(figures)),
        ("without estimate", f"{figures['without_estimate']} frames"),
        ("without force", f"{figures['without_force']} frames"),
        ("last margin", _describe_margin(estimates[-1])),
    )
    _show_figures(rows, replay.csv)


def prepare_frames(request: EstimateRequest) -> tuple[MarkerStreamConfiguration, list[MarkerFrame]]:
    """Header and frames as the software of a laboratory would send them, in metres with z up.

    Raises the errors of ``estimate-com`` for a recording that cannot be used.
    """
    from stridelab.pipelines.com_inputs import merged_subject
    from stridelab.recordings.foot_contact import is_treadmill
    from stridelab.recordings.marker_sets import identify
    from stridelab.recordings.plate_contacts import sampled_wrench

    task, inputs = _read_inputs(request, needs_force=False)
    trial = inputs.trial.recording
    subject = merged_subject(task.recording.subject, trial.subject, inputs.mass.known_kg)
    plates = [plate for plate in trial.plates if plate.use]
    landmarks, recognised = dict(inputs.trial.match.landmarks), identify(list(trial.markers_m)).landmarks
    header = MarkerStreamConfiguration(
        labels=list(trial.markers_m),
        marker_map={} if recognised == landmarks else landmarks,
        rate_hz=trial.marker_rate_hz,
        person=MarkerPerson(mass_kg=subject.mass_kg, height_m=subject.height_m, sex=subject.sex),
        plates=[MarkerPlate(corners=plate.corners_m.tolist()) for plate in plates],
        belt_speed_m_s=math.hypot(*inputs.geometric.ground_m_s[:2]) if is_treadmill(trial) else 0.0,
        title=request.file.name[:80],
    )
    read_s = trial.time_s + inputs.latency.applied_s
    tracks = [sampled_wrench(plate, trial.force_rate_hz, read_s) for plate in plates]
    frames = []
    for k, t_s in enumerate(trial.time_s.tolist()):
        markers = [_finite_triple(track[k].tolist()) for track in trial.markers_m.values()]
        forces = [PlateForce(force_n=f[k].tolist(), moment_nm=nu[k].tolist()) for f, nu in tracks]
        frames.append(MarkerFrame(t_s=t_s, markers=markers, plates=forces or None))
    return header, frames


FRAME_COLUMNS = (*COLUMNS[:7], "xcom_x_m", "xcom_y_m", "margin_ap_m", "margin_ml_m", "left", "right")


def _frame_row(estimate: FrameEstimate) -> list[float | bool | None]:
    """A row of the file: empty cells where there is no estimate."""
    nothing = (None, None, None)
    margin = estimate.margin_m
    return [
        estimate.t_s,
        *(estimate.com_m or nothing),
        *(estimate.velocity_m_s or nothing),
        *(estimate.xcom_m or nothing)[:2],
        None if margin is None else margin.ap,
        None if margin is None else margin.ml,
        estimate.contact.left,
        estimate.contact.right,
    ]


def _describe_margin(estimate: FrameEstimate) -> str:
    margin = estimate.margin_m
    if margin is None:
        return f"no margin ({estimate.margin_reason})"
    return f"{100.0 * margin.ap:+.1f} cm ahead, {100.0 * margin.ml:+.1f} cm sideways"


def write_csv(path: Path, rows: Sequence[Sequence[object]], columns: Sequence[str] = COLUMNS) -> None:
    """One row per sample, below the names of the columns. Raises ``InvalidInput`` (``output-not-writable``)."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow(columns)
            table.writerows(rows)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InvalidInput(
            "output-not-writable", f"Cannot write to {path}: {reason}.", [Fault("--csv", reason)]
        ) from error


def show_replay(played: ReplayResult, replay: Replay) -> None:
    """Print the summary as a table."""
    figures, last = played.to_json(), played.estimates[-1]
    rows = (
        ("method", played.method),
        ("played", f"{figures['samples']} samples in {played.played_s:.2f} s, {replay.block} per message"),
        ("answered", _describe_times(figures)),
        ("last position", " / ".join(f"{x:.3f}" for x in last.com_m) + " m (x / y / z)"),
        ("its band", " / ".join(f"{1e3 * x:.1f}" for x in last.sd_m) + " mm, one standard deviation"),
    )
    _show_figures(rows, replay.csv)


def _finite_triple(triple: Sequence[float]) -> tuple[float, float, float] | None:
    x, y, z = triple
    return None if math.isnan(x + y + z) else (x, y, z)
