"""Do what README says with a stopwatch, from a fresh clone in an empty home; called by ``scripts/newcomer``.

The browser is this machine's Chromium. Whatever the service prints is passed on with the time at which it came, and a
step that does not come to its end stops the run.
"""

import argparse
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil
from playwright.sync_api import Browser, Page, sync_playwright

from stridelab.client import Client

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "newcomer.md"
BEGIN, END = "<!-- measured by scripts/newcomer -->", "<!-- end of the measured part -->"
SAMPLE: Final = "models/recordings/sample-walk/recording.c3d"
CHROMIUM: Final = shutil.which("chromium-headless-shell") or shutil.which("chromium")
FLAGS: Final = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE_S: Final = 1200.0


@dataclass
class Stopwatch:
    """Steps with their seconds, and those that count from ``make serve`` on."""

    serving: psutil.Process | None = None
    rows: list[tuple[str, str, float, float | None, float | None]] = field(default_factory=list)

    def step(self, what: str, how: str, took_s: float) -> None:
        since = None if self.serving is None else time.time() - self.serving.create_time()
        busy = None if self.serving is None else processor_s(self.serving)
        self.rows.append((what, how, took_s, since, busy))
        say(f"{took_s:7.1f} s  {what} (in all {since or 0:.1f} s, {busy or 0:.1f} s of processor)")


def say(line: str) -> None:
    """Print at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def processor_s(process: psutil.Process) -> float:
    """Processor time of the process and its descendants; wall-clock time is less only on several cores."""
    total_s = 0.0
    for each in (process, *process.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            times = each.cpu_times()
            total_s += times.user + times.system + times.children_user + times.children_system
    return total_s


def newcomers_environment(home: Path, port: int, *, cold: bool) -> dict[str, str]:
    """Environment without this checkout's virtual environment, settings and caches, except that of packages."""
    variables = {
        key: value for key, value in os.environ.items() if not key.startswith(("STRIDELAB_", "XDG_", "VIRTUAL_"))
    }
    path = [part for part in variables["PATH"].split(os.pathsep) if ".venv" not in part and ".uv" not in part]
    caches = (
        {}
        if cold
        else {"UV_CACHE_DIR": str(Path.home() / ".cache/uv"), "PIP_CACHE_DIR": str(Path.home() / ".cache/pip")}
    )
    return {**variables, **caches, "PATH": os.pathsep.join(path), "HOME": str(home), "STRIDELAB_PORT": str(port)}


@contextmanager
def serving(clone: Path, environment: dict[str, str], watch: Stopwatch, what: str) -> Iterator[None]:
    """``make serve`` until its address answers; Ctrl-C at the end."""
    began = time.monotonic()
    process = subprocess.Popen(
        ["make", "serve"], cwd=clone, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    watch.serving = psutil.Process(process.pid)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            say(f"    {time.monotonic() - began:6.1f} s | {line.rstrip()}")
            if "is running on" in line:
                break
        else:
            raise SystemExit("make serve came to no end")
        watch.step(what, "`make serve`", time.monotonic() - began)
        yield
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(60)


@contextmanager
def tab(browser: Browser) -> Iterator[Page]:
    """A tab that is closed at once, because scenes are drawn by the processor here."""
    page = browser.new_page()
    page.set_default_timeout(1e3 * PATIENCE_S)
    yield page
    page.close()


def planned_in_the_browser(page: Page, base: str, watch: Stopwatch) -> str:
    """Press Plan under the stairs and wait until the viewer plays; the id of the plan."""
    began = time.monotonic()
    page.goto(base)
    card = page.locator("li", has=page.get_by_role("heading", name="Six stairs"))
    card.get_by_role("button", name="Plan").click()
    page.wait_for_url("**/view/?plan=*")
    page.wait_for_selector("[data-player][data-ready]")
    first = page.locator("[data-time]").text_content()
    page.wait_for_function("(first) => document.querySelector('[data-time]').textContent !== first", arg=first)
    watch.step(
        "the first animated plan", "open the page, press **Plan** under the six stairs", time.monotonic() - began
    )
    return re.findall(r"plan=([0-9a-f]+)", page.url)[0]


def lines_of_readme() -> tuple[str, str]:
    """The shell lines of the human and of the robot wing, as README gives them."""
    block = re.search(
        r"((?:    .*\n|\n)*    api=(?:.*\n|\n)*?)Or without", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    assert block is not None, "README has no lines that begin with api="
    human, robot = block.group(1).strip("\n").split("\n\n")
    return human, f"{human.splitlines()[0]}\n{robot}"


def scripted(lines: str, port: int, clone: Path, environment: dict[str, str]) -> str:
    """Run the shell lines against this port; return their output."""
    lines = lines.replace("127.0.0.1:8000", f"127.0.0.1:{port}")
    run = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", lines], cwd=clone, env=environment, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    if run.returncode:
        raise SystemExit(f"README's lines fail: {run.stderr}\n{run.stdout}")
    return run.stdout


def machine(began_load: str) -> str:
    """The machine in one line."""
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    memory = int(re.findall(r"MemTotal:\s*(\d+)", Path("/proc/meminfo").read_text(encoding="utf-8"))[0])
    return (
        f"{os.cpu_count()} cores ({cpu.group(1) if cpu else 'unknown'}), {memory / 2**20:.0f} GiB; load average "
        f"{began_load} at the beginning, {loads()} at the end"
    )


def loads() -> str:
    """Load averages of the last 1, 5 and 15 minutes."""
    return " ".join(f"{load:.1f}" for load in os.getloadavg())


def seconds(value: float | None) -> str:
    """In a cell."""
    return "" if value is None else f"{value:.1f} s"


def table(watch: Stopwatch, about: str, *, cold: bool) -> str:
    """The run as Markdown."""
    rows = [
        f"| {what} | {how} | {took_s:.1f} s | {seconds(since)} | {seconds(busy)} |"
        for what, how, took_s, since, busy in watch.rows
    ]
    today, cache = time.strftime("%Y-%m-%d", time.gmtime()), "without a" if cold else "with a warm"
    head = f"Measured on {today}, {cache} package cache, on {about}."
    return "\n".join(
        [
            head,
            "",
            "| what | typed or clicked | took | since `make serve` | of processor |",
            "| --- | --- | --- | --- | --- |",
            *rows,
        ]
    )


def run(place: Path, port: int, *, cold: bool) -> str:
    """All steps; the table."""
    load, home, watch = loads(), place / "home", Stopwatch()
    home.mkdir()
    environment = newcomers_environment(home, port, cold=cold)
    clone, base = home / "stridelab", f"http://127.0.0.1:{port}"
    began = time.monotonic()
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], env=environment, check=True)
    watch.step("a clone", "`git clone`", time.monotonic() - began)
    shutil.copyfile(clone / SAMPLE, clone / "trial.c3d")
    human, robot = lines_of_readme()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        with serving(clone, environment, watch, "the service for the first time"):
            with tab(browser) as page:
                plan = planned_in_the_browser(page, base, watch)
            with Client(base) as client:
                client.wait(plan, PATIENCE_S)
                if not client.result(plan).summary["certificate"]["passed"]:
                    raise SystemExit("the plan's certificate is not passed")
            began = time.monotonic()
            output = scripted(human, port, clone, environment)
            assert '"method"' in output, output
            watch.step("an estimate of `trial.c3d`", "README's lines of the human wing", time.monotonic() - began)
            began = time.monotonic()
            output = scripted(robot, port, clone, environment)
            assert '"passed": true' in output, output
            watch.step("a certificate", "README's lines of the robot wing", time.monotonic() - began)
        with serving(clone, environment, watch, "the service for the second time"):
            began = time.monotonic()
            with tab(browser) as page:
                page.goto(f"{base}/view/?plan={plan}")
                page.wait_for_selector("[data-player][data-ready]")
            watch.step("the plan of before, in the viewer", "press **Watch**", time.monotonic() - began)
        browser.close()
    return table(watch, machine(load), cold=cold)


def main() -> None:
    """Run in a folder that is removed at the end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cold", action="store_true", help="no package cache")
    parser.add_argument("--write", action="store_true", help="put the table into docs/newcomer.md")
    parser.add_argument("--port", type=int, default=8490)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="newcomer-") as folder:
        place = Path(folder)
        place.chmod(0o755)  # the database of root runs under another account
        results = run(place, arguments.port, cold=arguments.cold)
    say(results)
    if arguments.write:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n\n{results}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
