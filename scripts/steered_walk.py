"""Steers a robot with random commands in physics, as a live session does, and says how far that goes."""

import time
from collections.abc import Iterator
from typing import Annotated, Final

import numpy as np
import typer
from rich.console import Console

from stridelab.pipelines.commission_robot import foot_places_m, scaled_walk
from stridelab.pipelines.live.live_replay import LiveReplay
from stridelab.pipelines.plan_motion import plan_scenario_motion
from stridelab.robots.loader import load_robot
from stridelab.schemas.live.messages import MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S, LivePush, LiveSteer
from stridelab.schemas.scenarios import Scenario

HOLD_S: Final = (3.0, 8.0)
"""Least and most time for which a command is held."""
FLOOR_M: Final = 95.0
TICK_S: Final = 0.1
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
    live, draws = steerable(robot), np.random.default_rng(seed)
    began, until_s, push_at_s, n_pushes = time.process_time(), 60.0 * minutes, 10.0, 0
    errors: list[np.ndarray] = []
    recovering_s, said_s, commands = 0.0, 60.0, random_commands(draws)
    while live.time_s < until_s and live.fall is None:
        command, hold_s = next(commands)
        start = pose_of(live)
        end_s = min(live.time_s + hold_s, until_s)
        while live.time_s < end_s and live.fall is None:
            live.steer(command)
            if push and live.time_s > push_at_s:
                angle, size = draws.uniform(0.0, 2.0 * np.pi), push * load_robot(robot).mass_kg
                live.push_link(LivePush(type="push", impulse_ns=(size * np.cos(angle), size * np.sin(angle), 0.0)))
                push_at_s, n_pushes = push_at_s + 10.0, n_pushes + 1
            live.advance(TICK_S, 1e9)
            frame = live.frame()
            recovering_s += TICK_S * (frame.doing == "recovery")
        if live.time_s >= said_s:
            out.print(f"{live.time_s / 60.0:.1f} minutes, {live.frame().steps} steps")
            said_s += 60.0
        errors.append(np.abs(turned_way(start, pose_of(live), command, hold_s)))
    frame, took_s = live.frame(), time.process_time() - began
    ended = "no fall" if live.fall is None else live.fall.summary
    out.print(f"{robot}, seed {seed}: {live.time_s / 60.0:.2f} of {minutes:g} minutes; {ended}")
    out.print(f"{len(errors)} commands, {frame.steps} steps, {n_pushes} pushes, {recovering_s:.1f} s of recovery steps")
    ahead, turn = np.mean(errors, axis=0)
    out.print(f"mean error of the way per command {ahead:.2f} m, of the heading {np.degrees(turn):.0f} degrees")
    out.print(f"{took_s / live.time_s:.2f} s of processor per second")


def steerable(name: str) -> LiveReplay:
    """A robot that stands on a large level floor."""
    robot = load_robot(name)
    walk = scaled_walk(robot, foot_places_m(robot), 0.7)[0]
    for box in walk["terrain"]:
        box["size_m"][:2] = [FLOOR_M, FLOOR_M]
    return LiveReplay(robot, plan_scenario_motion(Scenario.model_validate(walk)), {})


def random_commands(draws: np.random.Generator) -> Iterator[tuple[LiveSteer, float]]:
    """Commands and their durations, without end."""
    limits = np.array([MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S])
    while True:
        ahead, left, turn = draws.choice(MODES) * limits * draws.uniform([0.0, -1.0, -1.0], 1.0)
        yield LiveSteer(type="steer", ahead_m_s=ahead, left_m_s=left, turn_rad_s=turn), float(draws.uniform(*HOLD_S))


def pose_of(live: LiveReplay) -> np.ndarray:
    """Position of the CoM (m) and heading of the base (rad)."""
    frame = live.frame()
    w, x, y, z = frame.links[0][3:]
    return np.array([*frame.com_m[:2], np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))])


def turned_way(start: np.ndarray, end: np.ndarray, command: LiveSteer, hold_s: float) -> np.ndarray:
    """Distance from the commanded end of the way (m), and from its heading (rad), without time to change velocity."""
    heading = start[2] + command.turn_rad_s * np.linspace(0.0, hold_s, 100)
    c, s = np.cos(heading), np.sin(heading)
    velocity = np.array([command.ahead_m_s * c - command.left_m_s * s, command.ahead_m_s * s + command.left_m_s * c])
    goal = start[:2] + velocity.mean(axis=1) * hold_s
    off = end[2] - start[2] - command.turn_rad_s * hold_s
    return np.array([np.linalg.norm(end[:2] - goal), np.angle(np.exp(1j * off))])


if __name__ == "__main__":
    typer.run(main)
