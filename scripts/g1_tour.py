"""The tour of a public benchmark, walked by the steered walk of this project."""

import csv
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from scipy.stats import binomtest

from experiments import tour
from experiments.steered import steerable_robot
from stridelab.robots.loader import load_robot
from stridelab.schemas.live.messages import MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S, LiveSteer
from stridelab.wholebody.replay.disturbances import Push

out = Console(highlight=False)
SETTLE_S = 3.0


@dataclass(frozen=True)
class TourRun:
    """How one run went; errors are means over the waypoints whose time was over, and over the last one.

    ``reached`` counts the waypoints near which the robot was at the end of their time. ``punched`` is the joint of the
    last punch before a fall, ``punch_ns`` its size, ``since_s`` the time from it to the fall.
    """

    run_id: int
    survival_s: float
    completed: bool
    waypoints: int
    reached: int
    position_error_cm: float
    heading_error_deg: float
    lost_walks: int
    steps: int
    punched: str = ""
    punch_ns: float = 0.0
    since_s: float = 0.0
    why: str = ""


def main(
    runs: Annotated[int, typer.Option(help="Number of runs.")] = 64,
    first: Annotated[int, typer.Option(help="Id of the first run.")] = 0,
    punches: Annotated[bool, typer.Option(help="Punch the robot.")] = True,
    arms: Annotated[bool, typer.Option(help="Let a servo move the arms; otherwise they are the controller's.")] = True,
    seconds: Annotated[float, typer.Option(help="Length of a run.")] = tour.WAYPOINTS * tour.SEGMENT_S,
    csv_file: Annotated[Path | None, typer.Option("--out", help="Add a row per run to this CSV file.")] = None,
) -> None:
    """Walk the tour and say how far that goes."""
    began_s, done = time.process_time(), list[TourRun]()
    for run_id in range(first, first + runs):
        run = walk_tour(run_id, punches=punches, arms=arms, seconds=seconds)
        done.append(run)
        ended = "completed" if run.completed else f"fell at {run.survival_s:.1f} s: {run.why}"
        out.print(
            f"{run_id}: {run.reached} of {run.waypoints} reached, {run.position_error_cm:.0f} cm, "
            f"{run.heading_error_deg:.0f} degrees, {run.lost_walks} walks lost; {ended}"
        )
        if csv_file is not None:
            add_row(csv_file, run)
    for line in summary_lines(done):
        out.print(line)
    out.print(f"{time.process_time() - began_s:.0f} s of processor")


def walk_tour(run_id: int, *, punches: bool, arms: bool, seconds: float) -> TourRun:
    """One run of the tour."""
    robot = load_robot("g1")
    live, walk = steerable_robot("g1", floor_m=12.0), tour.ArmWalk(run_id, robot)
    steering = None
    if arms:
        live.leave_joints(walk.servo)
    still = LiveSteer(type="steer", ahead_m_s=0.0, left_m_s=0.0, turn_rad_s=0.0)
    while live.time_s < SETTLE_S - 1e-9 and live.fall is None:
        live.steer(still)
        live.advance(tour.PERIOD_S, np.inf)
    released_s = live.time_s
    hits = [_since(push, released_s) for push in tour.draw_punches(run_id, robot)] if punches else []
    waiting, hit = list(hits), None
    limits = (MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S)
    ends: list[tuple[float, float]] = []
    lost = 0
    for k in range(round(seconds / tour.PERIOD_S)):
        elapsed_s = k * tour.PERIOD_S
        position_m, yaw = live.base_pose
        pose = np.array([*position_m[:2], yaw])
        if steering is None:
            steering = tour.TourSteering(tour.draw_waypoints(run_id), pose, limits)
        if k and k % round(tour.SEGMENT_S / tour.PERIOD_S) == 0:
            ends.append((steering.off_m, abs(steering.off_rad)))
        ahead, left, turn = steering.command(elapsed_s, pose)
        if k and arms:
            walk.advance(elapsed_s)
        if waiting and waiting[0].time_s <= live.time_s + 1e-6:
            hit = waiting.pop(0)
            live.add_push(hit)
        live.steer(LiveSteer(type="steer", ahead_m_s=ahead, left_m_s=left, turn_rad_s=turn))
        before = live.is_recovering
        live.advance(tour.PERIOD_S, np.inf)
        lost += live.is_recovering and not before
        if live.fall is not None or live.base_pose[0][2] < tour.LOW_PELVIS_M:
            break
    assert steering is not None, "a run has at least one period"
    fell = live.fall is not None
    if not fell:
        ends.append((steering.off_m, abs(steering.off_rad)))
    position, heading = np.mean(ends, axis=0) if ends else (np.nan, np.nan)
    ended_s = live.fall.time_s - released_s if live.fall is not None else seconds
    run = TourRun(
        run_id=run_id,
        survival_s=round(ended_s, 2),
        completed=not fell,
        waypoints=len(ends),
        reached=sum(off < tour.AWAY_M and turned < tour.TURNED_RAD for off, turned in ends),
        position_error_cm=round(100.0 * float(position), 1),
        heading_error_deg=round(float(np.degrees(heading)), 1),
        lost_walks=lost,
        steps=live.frame().steps,
    )
    if live.fall is None:
        return run
    why = " ".join([live.fall.summary, *live.fall.reasons[1:2]])
    last = {} if hit is None else _blow(hit, live.fall.time_s)
    return TourRun(**asdict(run) | last | {"why": why})


def _since(push: Push, released_s: float) -> Push:
    return Push(push.time_s + released_s, push.impulse_ns, push.duration_s, push.link, push.at_joint)


def _blow(push: Push, fall_s: float) -> dict[str, object]:
    size_ns, since_s = float(np.linalg.norm(push.impulse_ns)), fall_s - push.time_s
    return {"punched": push.link or "", "punch_ns": round(size_ns, 1), "since_s": round(since_s, 2)}


def summary_lines(runs: list[TourRun]) -> Iterator[str]:
    """What the runs come to."""
    n, completed = len(runs), sum(run.completed for run in runs)
    low, high = binomtest(completed, n).proportion_ci(method="wilson")
    survival_s = np.array([run.survival_s for run in runs])
    yield f"{n} runs: completed {completed} ({completed / n:.0%}; 95 % interval {low:.0%} to {high:.0%})"
    yield f"mean survival {survival_s.mean():.1f} s, median {np.median(survival_s):.1f} s"
    ended = [run for run in runs if run.waypoints]
    if ended:
        position = np.average([run.position_error_cm for run in ended], weights=[run.waypoints for run in ended])
        heading = np.average([run.heading_error_deg for run in ended], weights=[run.waypoints for run in ended])
        reached, of = sum(run.reached for run in runs), sum(run.waypoints for run in runs)
        yield f"waypoints: {reached} reached of {of}, mean error {position:.0f} cm and {heading:.0f} degrees"


def add_row(file: Path, run: TourRun) -> None:
    """Add a row to a CSV file."""
    is_new = not file.exists()
    with file.open("a", newline="") as stream:
        rows = csv.writer(stream)
        if is_new:
            rows.writerow(field.name for field in fields(run))
        rows.writerow(asdict(run).values())


if __name__ == "__main__":
    typer.run(main)
