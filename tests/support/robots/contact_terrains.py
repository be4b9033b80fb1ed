"""Terrains for the contact planner: stairs up and down, gaps, rails, at random; some of them lead nowhere."""

import math
from typing import Any

import numpy as np

Task = dict[str, Any]
KINDS = ("stairs up", "stairs down", "gaps", "rail")
FOOT_Y_M = 0.09


def box(name: str, x_m: tuple[float, float], top_m: float, width_m: float = 1.2, thick_m: float = 0.3) -> Task:
    center = [sum(x_m) / 2, 0.0, top_m - thick_m / 2]
    return {"name": name, "kind": "box", "center_m": center, "size_m": [x_m[1] - x_m[0], width_m, thick_m]}


def feet(x_m: float, z_m: float) -> list[Task]:
    sides = {"left_foot": FOOT_Y_M, "right_foot": -FOOT_Y_M}
    return [{"effector": name, "position_m": [x_m, y, z_m]} for name, y in sides.items()]


def task(terrain: list[Task], x_m: float, z_m: float) -> Task:
    """From the origin to level feet at ``x_m``."""
    ends = {"start": {"contacts": feet(0.0, 0.0)}, "goal": {"contacts": feet(x_m, z_m)}}
    return {"robot": "talos", "friction": 0.3, "terrain": terrain, **ends}


def planks(gap_m: float, number: int = 3, length_m: float = 0.5) -> Task:
    """Level planks with equal gaps between them."""
    starts = [-0.25 + i * (length_m + gap_m) for i in range(number)]
    return task([box(f"plank {i}", (x, x + length_m), 0.0) for i, x in enumerate(starts)], starts[-1] + 0.25, 0.0)


def random_task(rng: np.random.Generator, kind: str, most: int = 5) -> Task:
    """A way over up to ``most`` surfaces after the first."""
    number, top, x = int(rng.integers(2, most + 1)), 0.0, 0.4
    terrain = [box("start", (-0.4, 0.4), 0.0)]
    sign = -1.0 if kind == "stairs down" else 1.0
    for i in range(1, number + 1):
        gap = float(rng.uniform(0.0, 0.33)) if kind == "gaps" else 0.0
        top += 0.0 if kind == "gaps" else sign * float(rng.uniform(0.05, 0.19))
        length = 0.8 if i == number else float(rng.uniform(0.24, 0.45))
        terrain.append(box(f"part {i}", (x + gap, x + gap + length), top))
        x += gap + length
    made = task(terrain, x - 0.4, top)
    if kind == "rail":
        _with_rail(made, x - 0.4, top)
    return made


def _with_rail(made: Task, x_m: float, z_m: float) -> None:
    """A rail parallel to the way, the right hand on it at both ends."""
    slope, radius = z_m / x_m, 0.02
    a = math.atan(slope)

    def line(x: float) -> list[float]:
        return [x, -0.5, 0.8 + slope * x]

    ends = [[x + radius * math.sin(a), -0.5, 0.8 + slope * x - radius * math.cos(a)] for x in (-0.4, x_m + 0.8)]
    made["terrain"].append(
        {"name": "rail", "kind": "rail", "from_m": ends[0], "to_m": ends[1], "radius_m": radius, "friction": 0.6}
    )
    wxyz = [math.cos(a / 2), 0.0, -math.sin(a / 2), 0.0]
    for end, x in (("start", 0.2), ("goal", x_m + 0.2)):
        made[end]["contacts"].append({"effector": "right_hand", "position_m": line(x), "orientation_wxyz": wxyz})
