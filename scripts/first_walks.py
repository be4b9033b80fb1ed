"""Commission humanoids of installed packages and print the table of their first walks, ``docs/how-to/add-a-robot.md``.

usage: .venv/bin/python scripts/first_walks.py FOLDER [--search-s S] [--jobs N] [--only TEXT]

Every robot is proposed from its package as ``stridelab add-robot --use-estimates`` does, and commissioned in a process
of its own, ``--jobs`` of them at a time. Rows are appended to ``FOLDER/rows.jsonl`` with the hash of the package;
robots with a row of the same sources are not repeated. A process that ends otherwise, or whose sources are changed,
leaves no row: what it wrote, with the stacks at a fault, is in ``FOLDER/NAME.log``.
Packages beside the environment are on ``PYTHONPATH`` and ``AMENT_PREFIX_PATH``.
"""

import argparse
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from stridelab.errors import StridelabError
from stridelab.machine.models_folder import add_models_folder
from stridelab.pipelines.commissioning.commission_robot import commission_robot
from stridelab.robots.proposal.offered_estimates import estimate_of, take_estimates
from stridelab.robots.proposal.packages import find_description, find_package, pack_description
from stridelab.robots.proposal.propose import card_toml, propose_card, rebuild_description
from stridelab.schemas.robots import CommissionRobotInput

ROBOTS: Final = (
    "fourier-robot-descriptions/urdf/gr1t2.urdf",
    "fourier-robot-descriptions/urdf/gr2t2.urdf",
    "fourier-robot-descriptions/urdf/gr3.urdf",
    "fourier-robot-descriptions/urdf/qinglong.urdf",
    "holosoma/t1_29dof.xml",
    "example-robot-data/g1_29dof_with_hand_rev_1_0.urdf",
    "example-robot-data/talos_full_v2.urdf",
    "example-robot-data/alexander_v1.lowerBodyOnly.urdf",
    "example-robot-data/romeo_small.urdf",
    "example-robot-data/icub_reduced.urdf",
    "jvrc-description/jvrc1.urdf",
    "example-robot-data/human.urdf",
    "example-robot-data/simple_humanoid.urdf",
    "example-robot-data/alex_nub_hands.urdf",
    "example-robot-data/go2.urdf",
)
"""Package and description."""
SOURCES: Final = Path(__file__).parents[1] / "backend/stridelab"


def sources_sha256() -> str:
    """Hash of the Python and C++ files of the package."""
    total = hashlib.sha256()
    for path in sorted(each for each in SOURCES.rglob("*") if each.suffix in {".py", ".cpp", ".hpp", ".toml"}):
        total.update(path.read_bytes())
    return total.hexdigest()[:12]


def name_of(robot: str) -> str:
    """Name of the robot of a description."""
    stem = robot.partition("/")[2].rsplit(".", 1)[0].lower()
    return "".join(letter if letter.isalnum() else "-" for letter in stem)[-40:].strip("-")


def commission_one(robot: str, folder: Path, search_s: float) -> dict[str, Any]:
    """The row of one robot; a refusal is a row with its reason."""
    name = name_of(robot)
    row: dict[str, Any] = {"robot": robot, "search_s": search_s}
    started_s = time.perf_counter()
    own = folder / "robots"
    for old in (own / name, folder / "reachability" / name):
        shutil.rmtree(old, ignore_errors=True)
    own.mkdir(parents=True, exist_ok=True)
    try:
        package = find_package(robot.partition("/")[0])
        inside = find_description(package, robot.partition("/")[2])
        with tempfile.TemporaryDirectory() as scratch:
            packed = Path(scratch, f"{inside.stem}.zip")
            pack_description(package, inside, packed)
            assumed = rebuild_description(packed, packed.name, name, own, str(inside))
        proposal = propose_card(name, inside.stem, own, assumed)
        row["estimates"] = {key: value for key, how in proposal.assumed.items() if (value := estimate_of(how))}
        card, _ = take_estimates(proposal.card, proposal.assumed)
        (own / f"{name}.toml").write_text(card_toml(card), encoding="utf-8")
        row["proposal_s"] = time.perf_counter() - started_s
        add_models_folder(folder)
        request = CommissionRobotInput(robot=name, samples=3000, search_s=search_s)
        row["summary"] = commission_robot(request, folder, lambda _fraction, _message: None).summary.model_dump(
            mode="json"
        )
    except StridelabError as error:
        row["refused"] = f"{error.code}: {error.message}"
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    row["processor_s"] = sum(each.ru_utime + each.ru_stime for each in used)
    row["wall_s"], row["load"] = time.perf_counter() - started_s, os.getloadavg()[0]
    return row


def how_ended(code: int) -> str:
    """How a process ended that did not end as it should; empty for one that did."""
    return "" if code == 0 else f"ended by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def table_line(row: dict[str, Any]) -> str:
    """A line of the Markdown table."""
    times = f"{row['processor_s']:.0f}, {row['wall_s']:.0f} s"
    if "refused" in row:
        return f"| {row['robot']} | refused | {row['refused']} | {times} |"
    walk = row["summary"]["first_walk"]
    last, tried = walk["attempts"][-1], len(walk["attempts"])
    outcome = f"steps of {last['step_m']:.3f} m (attempt {tried})"
    if last["com_error_max_m"] is not None:
        outcome += f", {1e3 * last['com_error_max_m']:.1f} mm"
    states = ", ".join(("" if walk[key] else "not ") + key for key in ("certified", "completed"))
    abilities = [
        f"{one['name']} {one['value']:.3g} {one['unit']}" + ("+" if one["ended_by"] == "time" else "")
        for one in row["summary"]["capabilities"]
        if one["value"] is not None
    ]
    taken = [f"{nm:g} N m for {field.rpartition('.')[2]}" for field, nm in row["estimates"].items()]
    correction = ", ".join(taken) or "none"
    cells = row["robot"], f"{outcome}: {states}", correction, ", ".join(abilities) or "not searched", times
    return f"| {' | '.join(cells)} |" + ("" if walk["completed"] else f" {last['reason'][:300]}")


def main() -> None:
    """Commission the robots that have no row yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--search-s", type=float, default=0.0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", default="", help="robots whose name contains one of these, separated by commas")
    parser.add_argument("--one", default="", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        sys.stdout.write(json.dumps(commission_one(given.one, given.folder, given.search_s)) + "\n")
        return
    given.folder.mkdir(parents=True, exist_ok=True)
    rows_path, sources = given.folder / "rows.jsonl", sources_sha256()
    lines = rows_path.read_text().splitlines() if rows_path.exists() else []
    done = {(row["robot"], row["search_s"]) for row in map(json.loads, lines) if row["sources"] == sources}
    failed: list[str] = []
    wanted = [name for name in ROBOTS if any(part in name for part in given.only.split(","))]

    def walk_robot(robot: str) -> None:
        command = [sys.executable, "-X", "faulthandler", __file__, str(given.folder)]
        ended = subprocess.run(
            [*command, "--search-s", str(given.search_s), "--one", robot], check=False, capture_output=True, text=True
        )
        how = how_ended(ended.returncode)
        if not how and sources_sha256() != sources:
            how = "the sources were changed meanwhile"
        if how:
            log = given.folder / f"{name_of(robot)}.log"
            log.write_text(f"{how}\n{ended.stdout}\n{ended.stderr}", encoding="utf-8")
            sys.stderr.write(f"{robot}: {how}, see {log}\n")
            failed.append(robot)
            return
        row = json.loads(ended.stdout.splitlines()[-1]) | {"sources": sources}
        with rows_path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        sys.stdout.write(table_line(row) + "\n")
        sys.stdout.flush()

    with ThreadPoolExecutor(given.jobs) as pool:
        list(pool.map(walk_robot, [robot for robot in wanted if (robot, given.search_s) not in done]))
    if failed:
        sys.exit(f"no row: {', '.join(failed)}")


if __name__ == "__main__":
    main()
