"""The rolling wheel in the scene (the yoyo-man): rim, hub, the point on its spoke, ground line, and traced curve.

The wheel has radius 1; the page places, turns and scales it, because R differs from step to step. In its own
frame x is ahead and z up; it turns about y by theta, and the point hangs below the hub at theta = 0 (3.1), (3.2).
"""

from dataclasses import dataclass

import numpy as np

from stridelab_web.parquet import Columns
from stridelab_web.scene.frames import Hoop, Point, Sheet, Stick, Track

RIM, HUB, POINT, SPOKE = "/wheel/rim", "/wheel/hub", "/wheel/point", "/wheel/spoke"
TRACE, GROUND, HUB_PATH = "/wheel/trace", "/wheel/ground", "/wheel/hub_path"
POSE = 7


@dataclass(frozen=True)
class WheelFrames:
    """Nodes of the wheel; their columns are in the given sheet."""

    points: tuple[Point, ...] = ()
    sticks: tuple[Stick, ...] = ()
    hoops: tuple[Hoop, ...] = ()
    tracks: tuple[Track, ...] = ()


def add_wheel(sheet: Sheet, time_s: np.ndarray, wheel: Columns) -> WheelFrames:
    """Add the columns of ``wheel.parquet`` to ``sheet`` at the times ``time_s``; they are NaN between steps."""
    pose = np.full((len(time_s), POSE), np.nan)
    point, size = np.full((len(time_s), 3), np.nan), np.full((len(time_s), 1), np.nan)
    for number in np.unique(wheel["step"]):
        own = {name: values[wheel["step"] == number] for name, values in wheel.items()}
        if len(own["time_s"]) < 2:
            continue
        half = 0.5 * float(np.median(np.diff(own["time_s"])))
        inside = (time_s >= own["time_s"][0] - half) & (time_s <= own["time_s"][-1] + half)
        at_s = time_s[inside]

        def interpolate(track: np.ndarray, own_s: np.ndarray = own["time_s"], at_s: np.ndarray = at_s) -> np.ndarray:
            return np.asarray(np.interp(at_s, own_s, track))

        ahead = unit_ahead(own)
        hub = np.column_stack(
            [interpolate(own["hub_world_x_m"]), interpolate(own["hub_world_y_m"]), interpolate(own["hub_z_m"])]
        )
        before = interpolate(own["model_x_m"] - own["hub_x_m"])
        pose[inside] = np.column_stack([hub, wheel_quaternions(ahead, interpolate(own["theta_rad"]))])
        point[inside] = hub + before[:, None] * ahead
        point[inside, 2] = interpolate(own["model_z_m"])
        size[inside] = radius_m(own)
    hub_at, size_at, point_at = sheet.add_block(pose), sheet.add_block(size), sheet.add_block(point)
    ground_at = sheet.add_block(pose[:, :3] - size * [0.0, 0.0, 1.0])
    return WheelFrames(
        points=(Point(HUB, hub_at, "hub of the wheel"), Point(POINT, point_at, "point on the wheel")),
        sticks=(Stick(SPOKE, hub_at, point_at),),
        hoops=(Hoop(RIM, hub_at, size_at),),
        tracks=(Track(TRACE, point_at), Track(GROUND, ground_at), Track(HUB_PATH, hub_at)),
    )


def com_of(wheel: Columns) -> Columns:
    """The centre of mass that the wheel was fitted to, as a table with the columns of ``com.parquet``.

    Steps that are not adjacent are separated by a row of missing values.
    """
    order = np.argsort(wheel["time_s"], kind="stable")
    time = wheel["time_s"][order]
    columns = {"time_s": time} | {f"{axis}_m": wheel[f"{axis}_m"][order] for axis in "xyz"}
    if len(time) < 2:
        return columns
    gaps = np.flatnonzero(np.diff(time) > 1.5 * np.median(np.diff(time))) + 1
    between = 0.5 * (time[gaps - 1] + time[gaps])
    return {name: np.insert(values, gaps, between if name == "time_s" else np.nan) for name, values in columns.items()}


def unit_ahead(own: Columns) -> np.ndarray:
    """Unit vector ahead ``(3,)``, from the offset between hub and centre of mass."""
    offset = own["hub_x_m"] - own["x_ahead_m"]
    across = np.array([offset @ (own[f"hub_world_{axis}_m"] - own[f"{axis}_m"]) for axis in "xy"])
    return np.append(across / np.linalg.norm(across), 0.0)


def radius_m(own: Columns) -> float:
    """R: how far the hub moves per radian (3.1)."""
    theta = own["theta_rad"] - own["theta_rad"].mean()
    return float(theta @ own["hub_x_m"] / (theta @ theta))


def wheel_quaternions(ahead: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    """Quaternions wxyz ``(n, 4)`` of a wheel that faces ``ahead`` and has turned by ``theta_rad`` about its axle."""
    yaw = 0.5 * float(np.arctan2(ahead[1], ahead[0]))
    cos, sin = np.cos(0.5 * theta_rad), np.sin(0.5 * theta_rad)
    return np.column_stack([np.cos(yaw) * cos, -np.sin(yaw) * sin, np.cos(yaw) * sin, np.sin(yaw) * cos])
