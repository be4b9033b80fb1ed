"""From a frame to its answer, and to its picture, of a walk that is replayed in real time to a running service.

Usage: PYTHONPATH=tests .venv/bin/python tests/bench/live_latency.py http://127.0.0.1:8000 [--seconds 60] [--picture]

A simulated person walks at 100 Hz with 49 markers and two plates. The time of a frame counts from the instant at which
it is due, so that a service that falls behind is seen; --picture opens the page in headless Chromium and counts to the
end of the drawing.
"""

import argparse
import contextlib
import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright
from websockets.sync.client import ClientConnection, connect

from stridelab.recordings.plate_contacts import sampled_wrench
from stridelab.recordings.recording import Recording
from stridelab.schemas.streams import (
    FrameEstimate,
    MarkerFrame,
    MarkerPerson,
    MarkerPlate,
    MarkerStreamConfiguration,
    PlateForce,
)
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

SHOWN = """
    window.shown = [];
    addEventListener("DOMContentLoaded", () => {
        const body = document.querySelector("[data-body]");
        new MutationObserver(() => {
            window.shown.push([Number(body.dataset.shown), performance.timeOrigin + performance.now()]);
        }).observe(body, { attributes: true, attributeFilter: ["data-shown"] });
    });
"""
FLAGS = ("--no-sandbox", "--disable-gpu")


def walk(seconds: float) -> Recording:
    """A person on two plates."""
    person = HumanWalker(height_m=1.75, mass_kg=70.0, sex="male", speed_m_s=1.2, duration_s=seconds, seed=1).walk()
    return record(person, MeasurementNoise(), 0, lab="two_plates").recording


def frames_of(recording: Recording) -> list[MarkerFrame]:
    """All frames of a recording."""
    wrenches = [sampled_wrench(plate, recording.force_rate_hz, recording.time_s) for plate in recording.plates]
    return [
        MarkerFrame(
            t_s=t_s,
            markers=[track[k].tolist() for track in recording.markers_m.values()],
            plates=[PlateForce(force_n=f[k].tolist(), moment_nm=nu[k].tolist()) for f, nu in wrenches],
        )
        for k, t_s in enumerate(recording.time_s.tolist())
    ]


@contextlib.contextmanager
def watching(url: str, wanted: bool) -> Iterator[Page | None]:
    """The page of live streams in headless Chromium."""
    if not wanted:
        yield None
        return
    executable = next((path for name in ("chromium-headless-shell", "chromium") if (path := shutil.which(name))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=list(FLAGS))
        page = browser.new_page()
        page.add_init_script(SHOWN)
        page.goto(f"{url}/live")
        yield page
        browser.close()


def main() -> None:
    """Replay the walk and print the percentiles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--picture", action="store_true")
    options = parser.parse_args()
    recording = walk(options.seconds)
    header = MarkerStreamConfiguration(
        labels=list(recording.markers_m),
        rate_hz=recording.marker_rate_hz,
        person=MarkerPerson(mass_kg=70.0, height_m=1.75, sex="male"),
        plates=[MarkerPlate(corners=plate.corners_m.tolist()) for plate in recording.plates],
    )
    frames = frames_of(recording)
    answered_ms, overtaken = [], 0
    address = options.url.replace("http", "ws") + "/api/v1/stream/markers"
    with watching(options.url, options.picture) as page, connect(address, compression=None, max_size=None) as socket:
        socket.send(header.model_dump_json())
        assert "ready" in json.loads(socket.recv())
        if page is not None:
            page.get_by_text("frames per second").wait_for()
        began = time.time() + 0.1
        due_ms = {round(frame.t_s, 6): 1e3 * (began + frame.t_s) for frame in frames}
        sender = threading.Thread(target=send_in_time, args=(socket, frames, began))
        sender.start()
        for _ in frames:
            answer = FrameEstimate.model_validate_json(socket.recv())
            answered_ms.append(1e3 * time.time() - due_ms[round(answer.t_s, 6)])
            overtaken += answer.reason == "overtaken"
        sender.join()
        shown: list[Any] = [] if page is None else page.evaluate("window.shown")
    report("sample to answer", answered_ms)
    sys.stdout.write(f"overtaken: {overtaken} of {len(frames)} frames\n")
    if shown:
        report("sample to picture", [at_ms - due_ms[round(t_s, 6)] for t_s, at_ms in shown])
        sys.stdout.write(f"pictures per second: {len(shown) / options.seconds:.1f}\n")
    sys.stdout.write(f"load average: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")


def send_in_time(socket: ClientConnection, frames: Sequence[MarkerFrame], began: float) -> None:
    """Send each frame when it is due, as the software of a laboratory does, whether or not answers have come."""
    messages = [frame.model_dump_json() for frame in frames]
    for frame, message in zip(frames, messages, strict=True):
        time.sleep(max(0.0, began + frame.t_s - time.time()))
        socket.send(message)


def report(name: str, took_ms: list[float]) -> None:
    """Print the percentiles of some times."""
    p50, p95, p99 = np.percentile(took_ms, [50, 95, 99])
    sys.stdout.write(
        f"{name}: median {p50:.1f} ms, p95 {p95:.1f} ms, p99 {p99:.1f} ms, longest {max(took_ms):.1f} ms\n"
    )


if __name__ == "__main__":
    main()
