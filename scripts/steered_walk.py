"""Steers a robot with random commands in physics, as a live session does, and says how far that goes."""

import math
import time
from collections.abc import Iterator
from typing import Annotated, Final

import numpy as np
import typer
from rich.console import Console

from experiments.steered import steerable_robot
from stridelab.pipelines.live.live_replay import LiveReplay
from stridelab.robots.loader import load_robot
from stridelab.schemas.live.messages import MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S, LivePush, LiveSteer

HOLD_S: Final = (3.0, 8.0)
"""Least and most time for which a command is held."""
FLOOR_M: Final = 95.0
TICK_S: Final = 0.1
STARTED_S: Final = 1.5
"""Time after a new command from which its velocity is compared with the robot's."""
MODES: Final = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1))
"""Which of ahead, left and turning a command has."""
out = Console(highlight=False)


def main(
    robot: Annotated[str, typer.Option(help="A robot with two feet.")] = "talos",
    minutes: Annotated[float, typer.Option(help="Simulated time.")] = 10.0,
    seed: Annotated[int, typer.Option(help="Of the commands and pushes.")] = 0,
    push: Annotated[float, typer.Option(help="A push of this size, m/s, in a random direction every 10 s.")] = 0.0,
) -> None:
    """Walk, turn, stop and step sideways at random commands within the limits."""
    live, draws = steerable_robot(robot, FLOOR_M), np.random.default_rng(seed)
    began, until_s, push_at_s, n_pushes = time.process_time(), 60.0 * minutes, 10.0, 0
    wanted, done = list[np.ndarray](), list[np.ndarray]()
    recovering_s, said_s, commands = 0.0, 60.0, random_commands(draws)
    while live.time_s < until_s - 1e-6 and live.fall is None:
        command, hold_s = next(commands)
        ticks = list[np.ndarray]()
        for _ in range(round(min(hold_s, until_s - live.time_s) / TICK_S)):
            live.steer(command)
            if push and live.time_s > push_at_s:
                angle, size = draws.uniform(0.0, 2.0 * np.pi), push * load_robot(robot).mass_kg
                live.push_link(LivePush(type="push", impulse_ns=(size * np.cos(angle), size * np.sin(angle), 0.0)))
                push_at_s, n_pushes = push_at_s + 10.0, n_pushes + 1
            start = pose_of(live)
            live.advance(TICK_S, np.inf)
            if live.fall is not None:
                break
            ticks.append(velocity_between(start, pose_of(live), TICK_S))
            recovering_s += TICK_S * live.is_recovering
        if len(ticks) > round(STARTED_S / TICK_S):
            wanted.append(np.array([command.ahead_m_s, command.left_m_s, command.turn_rad_s]))
            done.append(np.mean(ticks[round(STARTED_S / TICK_S) :], axis=0))
        if live.time_s >= said_s:
            out.print(f"{live.time_s / 60.0:.1f} minutes, {live.frame().steps} steps, {recovering_s:.1f} s of recovery")
            for line in tracking_lines(np.array(wanted), np.array(done)):
                out.print(f"  {line}")
            said_s += 60.0
    frame, took_s = live.frame(), time.process_time() - began
    ended = "no fall" if live.fall is None else live.fall.summary
    out.print(f"{robot}, seed {seed}: {live.time_s / 60.0:.2f} of {minutes:g} minutes; {ended}")
    out.print(f"{len(done)} commands, {frame.steps} steps, {n_pushes} pushes, {recovering_s:.1f} s of recovery steps")
    for line in tracking_lines(np.array(wanted), np.array(done)):
        out.print(line)
    out.print(f"{took_s / live.time_s:.2f} s of processor per second")


def random_commands(draws: np.random.Generator) -> Iterator[tuple[LiveSteer, float]]:
    """Commands and their durations, without end."""
    limits = np.array([MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S])
    while True:
        ahead, left, turn = draws.choice(MODES) * limits * draws.uniform([0.0, -1.0, -1.0], 1.0)
        yield LiveSteer(type="steer", ahead_m_s=ahead, left_m_s=left, turn_rad_s=turn), float(draws.uniform(*HOLD_S))


def pose_of(live: LiveReplay) -> np.ndarray:
    """Position (m) and heading (rad) of the base."""
    position_m, heading_rad = live.base_pose
    return np.array([*position_m[:2], heading_rad])


def velocity_between(start: np.ndarray, end: np.ndarray, duration_s: float) -> np.ndarray:
    """Mean velocity ahead and to the left (m/s), in the axes of the robot, and of its heading (rad/s)."""
    turned = math.remainder(end[2] - start[2], math.tau)
    c, s = math.cos(start[2] + 0.5 * turned), math.sin(start[2] + 0.5 * turned)
    x, y = end[:2] - start[:2]
    return np.array([c * x + s * y, c * y - s * x, turned]) / duration_s


def tracking_lines(wanted: np.ndarray, done: np.ndarray) -> Iterator[str]:
    """How well commands ``(n, 3)`` were followed by mean velocities ``(n, 3)``, per direction."""
    for k, (name, unit) in enumerate((("ahead", "m/s"), ("left", "m/s"), ("turning", "rad/s"))):
        asked = np.abs(wanted[:, k]) > 0.0
        share = float((done[asked, k] * np.sign(wanted[asked, k])).sum() / max(np.abs(wanted[asked, k]).sum(), 1e-9))
        off = float(np.abs(done[:, k] - wanted[:, k]).mean())
        yield f"{name}: {share:.0%} of what {asked.sum()} commands ask; mean error of all {off:.3f} {unit}"


if __name__ == "__main__":
    typer.run(main)
