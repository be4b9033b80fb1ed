"""Measure the scenario editor's verdict on random drags: agreement with the complete plan, and processor time.

usage: measure_drags.py ROWS FIRST LAST    seeds FIRST to LAST, one drag of TALOS and one of HRP-2 each

Verdicts of complete plans (some seconds each) are written into the file ROWS, one JSON object per line, and read from
there by a later run; the editor is measured anew. Prints what differs, and the tables of docs/contact-sequences.md.
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from experiments.drags import ROBOTS, Drag, EditorVerdict, PlanVerdict, check_drag, draw_drag, open_scenes, plan_drag

FIRST_ANSWER_MS, COMPLETE_MS = 100.0, 150.0


def main() -> None:
    """Measure and print."""
    rows, first, last = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    measured: list[tuple[Drag, EditorVerdict]] = []
    for robot in ROBOTS:
        open_scenes(robot)
        drags = [draw_drag(robot, seed) for seed in range(first, last + 1)]
        measured += [(drag, check_drag(drag)) for drag in drags]
    truths = _plan_verdicts(rows, [drag for drag, _ in measured])
    for (drag, said), truth in zip(measured, truths, strict=True):
        if said.valid != truth.certified:
            why = f"{truth.stage}: {truth.reason}" if said.valid else said.reason
            place = f"{drag.effector} of {drag.scene}, phase {drag.phase}"
            _write_line(f"{drag.robot} {drag.seed} ({place}): says {'yes' if said.valid else 'no'}; {why}")
    _write_line(_agreement_table([said for _, said in measured], truths))
    _write_line(_time_table([said for _, said in measured]))


def _write_line(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def _plan_verdicts(rows: Path, drags: list[Drag]) -> list[PlanVerdict]:
    lines = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    truths = {(line.pop("robot"), line.pop("seed")): PlanVerdict(**line) for line in lines}
    with rows.open("a") as out:
        for drag in drags:
            at = drag.robot, drag.seed
            if at not in truths:
                truths[at] = plan_drag(drag)
                out.write(json.dumps({"robot": drag.robot, "seed": drag.seed, **asdict(truths[at])}) + "\n")
                out.flush()
    return [truths[drag.robot, drag.seed] for drag in drags]


def _agreement_table(said: list[EditorVerdict], truths: list[PlanVerdict]) -> str:
    table = ["| | agree with the certificate | says yes, plan fails | says no, certified |", "| --- " * 4 + "|"]
    for title, verdicts in (
        ("stances and shoes only", [one.stances for one in said]),
        ("with the motion between stances", [one.valid for one in said]),
    ):
        pairs = [(verdict, truth.certified) for verdict, truth in zip(verdicts, truths, strict=True)]
        agree, yes, no = (sum(test(*pair) for pair in pairs) for test in (_is_same, _is_too_kind, _is_too_strict))
        table.append(f"| {title} | {agree} of {len(pairs)} | {yes} | {no} |")
    return "\n".join(table) + "\n"


def _is_same(verdict: bool, certified: bool) -> bool:
    return verdict == certified


def _is_too_kind(verdict: bool, certified: bool) -> bool:
    return verdict and not certified


def _is_too_strict(verdict: bool, certified: bool) -> bool:
    return certified and not verdict


def _time_table(said: list[EditorVerdict]) -> str:
    table = ["| processor time | median | 95th percentile | longest | below the bar |", "| --- " * 5 + "|"]
    for title, times_s, bar_ms in (
        ("first answer", [one.first_s for one in said], FIRST_ANSWER_MS),
        ("complete verdict", [one.complete_s for one in said], COMPLETE_MS),
    ):
        ms = 1e3 * np.array(times_s)
        middle, high = np.percentile(ms, (50, 95))
        below = f"{(ms < bar_ms).sum()} of {len(ms)} below {bar_ms:g} ms"
        table.append(f"| {title} | {middle:.0f} ms | {high:.0f} ms | {ms.max():.0f} ms | {below} |")
    return "\n".join(table)


if __name__ == "__main__":
    main()
