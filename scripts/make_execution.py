"""Execute every bundled scenario with every robot, apply disturbances, and write the results as a page.

make_execution.py                      all that is not stored yet, then docs/theory/execution.md
make_execution.py --robots talos hrp2  only these; --anew computes again, --page only writes the page
make_execution.py --robustness talos   disturbances and boundaries of the three experiments of one robot
make_execution.py --estimators talos   estimators in front of the stabiliser, in the same three
"""

import argparse
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter

from experiments.execution import CASES, Execution, execute_scenario, replay_motion, whole_body_motion
from experiments.robustness import (
    EXPERIMENTS,
    N_INSTANTS,
    PUSH_NS,
    SIDES,
    applies_to,
    fixed_disturbances,
    lateral_push,
    push_times_s,
    scalable_disturbances,
    survival_boundary,
)
from stridelab.pipelines.replays.replay_estimation import CONDITIONS, LOW_NOISE, replay_estimators
from stridelab.robots.loader import load_robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import Disturbances

PAGE = Path(__file__).resolve().parent.parent / "docs" / "theory" / "execution.md"
REPORTS: TypeAdapter[list[Execution]] = TypeAdapter(list[Execution])
BORNE: TypeAdapter[dict[str, float]] = TypeAdapter(dict[str, float])
TABLES = (
    (
        "borne",
        "disturbances of the replay",
        (
            "Largest CoM error, mm; *control*: joint readings and stabiliser "
            "([more](whole-body.md#a-control-that-reads-late));\n*most*: the largest disturbance that is survived "
            "(bisection);\n*survived*: the number of survived pushes, at evenly spaced instants."
        ),
    ),
    (
        "estimated",
        "an estimator in front of the stabiliser",
        "Largest error of the CoM, mm (`studies.replay_estimation`); the filter is the online filter of chapter 2.",
    ),
)
INTRO = """# Execution of every bundled scenario

Written by `scripts/make_execution.py`. Each scenario is planned with the default densities, followed by the
whole-body controller at 250 Hz, checked by the certificate and replayed once in the physics simulation. The
parameters that depend on the robot (its feet, the reach of its hands) are in `scripts/experiments/execution.py`. The
page [whole body](whole-body.md) defines the checks of certificate and replay. *Speed* is the duration of the motion
divided by the processor seconds of the whole-body stage, on one core while the other one was busy. Random pushes are
elsewhere ([what is survived](whole-body.md#what-is-survived)).
"""


def main() -> None:
    """Read the command line, run, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="*", default=list(CASES))
    parser.add_argument("--robustness", metavar="ROBOT")
    parser.add_argument("--estimators", metavar="ROBOT")
    parser.add_argument("--experiments", nargs="*", default=list(EXPERIMENTS), choices=EXPERIMENTS)
    parser.add_argument("--boundaries", action="store_true", help="bisect them as well")
    parser.add_argument("--out", type=Path, default=Path(".data") / "execution", metavar="DIR")
    parser.add_argument("--anew", action="store_true", help="compute stored results again")
    parser.add_argument("--page", action="store_true", help="only write the page")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.robustness:
        borne(
            arguments.robustness,
            arguments.experiments,
            arguments.out,
            boundaries=arguments.boundaries,
            anew=arguments.anew,
        )
    elif arguments.estimators:
        estimated(arguments.estimators, arguments.experiments, arguments.out, anew=arguments.anew)
    elif not arguments.page:
        for robot in arguments.robots:
            carried_out(robot, arguments.out, anew=arguments.anew)
    PAGE.write_text("\n".join(page(arguments.out)), encoding="utf-8")


def carried_out(robot: str, folder: Path, *, anew: bool = False) -> list[Execution]:
    """Execute all scenarios of one robot; results are stored after each."""
    path = folder / f"{robot}.json"
    known = {} if anew or not path.is_file() else {e.name: e for e in REPORTS.validate_json(path.read_bytes())}
    for name in CASES[robot]:
        if name not in known:
            known[name] = execute_scenario(robot, name)
            sys.stderr.write(f"{robot} {name}: {known[name].failed or known[name].is_certified}\n")
            path.write_bytes(REPORTS.dump_json(list(known.values()), indent=1))
    return list(known.values())


def borne(robot: str, experiments: list[str], folder: Path, *, boundaries: bool, anew: bool = False) -> None:
    """Disturbances and boundaries, a file per experiment, kept after each replay; a fall is -1."""
    for name in experiments:
        path = folder / f"{robot}-{name}-borne.json"
        known = {} if anew or not path.is_file() else BORNE.validate_json(path.read_bytes())
        motion = whole_body_motion(robot, name)
        for what, disturbed in fixed_disturbances(float(motion.time_s[-1])).items():
            if what not in known and applies_to(name, what):
                replay = replay_motion(robot, motion, disturbed)
                known[what] = 1e3 * replay.com_error_max_m if not replay.fell else -1.0
                path.write_bytes(BORNE.dump_json(known, indent=1))
        for what, (too_much, of_size) in scalable_disturbances(float(motion.time_s[-1])).items() if boundaries else ():
            row = f"most: {what}"
            if row not in known and applies_to(name, what):
                known[row] = survival_boundary(partial(survives, robot, motion, of_size), too_much)
                path.write_bytes(BORNE.dump_json(known, indent=1))
        for side, y in SIDES.items() if boundaries else ():
            row = f"survived, of {N_INSTANTS} pushes of {PUSH_NS:g} Ns to the {side}"
            if row not in known:
                tried = (lateral_push(at_s, y * PUSH_NS) for at_s in push_times_s(float(motion.time_s[-1])))
                known[row] = float(sum(not replay_motion(robot, motion, disturbed).fell for disturbed in tried))
                path.write_bytes(BORNE.dump_json(known, indent=1))


def estimated(robot: str, experiments: list[str], folder: Path, *, anew: bool = False) -> None:
    """Every estimator under every condition, a file per experiment, kept after each replay; a fall is -1."""
    for name in experiments:
        path = folder / f"{robot}-{name}-estimated.json"
        known = {} if anew or not path.is_file() else BORNE.validate_json(path.read_bytes())
        motion = whole_body_motion(robot, name)
        for condition, disturbed in CONDITIONS.items():
            for who, observe in replay_estimators(load_robot(robot), disturbed.sensor_noise or LOW_NOISE).items():
                row = f"{condition}: {who}"
                if row not in known:
                    replay = replay_motion(robot, motion, disturbed, observe)
                    known[row] = 1e3 * replay.com_error_max_m if not replay.fell else -1.0
                    path.write_bytes(BORNE.dump_json(known, indent=1))


def survives(robot: str, motion: WholeBodyMotion, of_size: Callable[[float], Disturbances], size: float) -> bool:
    """Whether the robot does not fall under a disturbance of this size."""
    return not replay_motion(robot, motion, of_size(size)).fell


def page(folder: Path) -> Iterable[str]:
    """The page from the stored results."""
    yield INTRO
    for robot in CASES:
        path = folder / f"{robot}.json"
        if path.is_file():
            yield from _table(robot, REPORTS.validate_json(path.read_bytes()))
    for robot in CASES:
        for kind, title, caption in TABLES:
            paths = {name: folder / f"{robot}-{name}-{kind}.json" for name in EXPERIMENTS}
            executions = {
                name: BORNE.validate_json(path.read_bytes()) for name, path in paths.items() if path.is_file()
            }
            if executions:
                yield from _by_experiment(f"{robot}: {title}", caption, executions)


def _table(robot: str, executions: list[Execution]) -> Iterable[str]:
    yield f"## {robot}\n"
    yield (
        "| scenario | certificate | CoM, mm | landing, mm | legs to terrain, mm | torque: legs, arms | speed "
        "| replay completed | CoM, mm | slip, landing, mm | torque asked | hand: N, share |"
    )
    yield "| --- " * 12 + "|"
    for e in executions:
        yield f"| `{e.name}` | {_verdict(e)} | {_figures(e)} |"
    yield ""


def _verdict(e: Execution) -> str:
    failed = [f"{c.name} {c.value:.3g}, {c.limit:.3g} {c.unit} wanted" for c in e.checks if not c.passed]
    return e.failed or ("passed" if not failed else "**not passed**: " + "; ".join(failed))


def _figures(e: Execution) -> str:
    if not e.checks or e.cpu_s is None:
        return " | ".join([""] * 10)
    torque = f"{e.check_value('torque_ratio_max_legs_torso'):.2f}, {e.check_value('torque_ratio_max_arms'):.2f}"
    body = [
        f"{1e3 * e.check_value('com_error_max'):.2f}",
        f"{1e3 * e.check_value('landing_error_max'):.2f}",
        f"{1e3 * e.check_value('leg_terrain_distance_min'):.1f}",
        torque,
        f"{e.duration_s / e.cpu_s['whole body']:.1f}",
    ]
    if e.replay is None:
        return " | ".join([*body, "", "", "", "", ""])
    r = {key: 1e3 * value for key, value in e.replay.items()}
    com = "**falls**" if e.fell else f"{r['com_error_max_m']:.1f}"
    hand = ""
    if "hand_force_mean_n" in e.replay:
        hand = f"{e.replay['hand_force_mean_n']:.0f}, {e.replay['hand_contact_share']:.0%}"
    slip = f"{r['foot_slip_max_m']:.1f}, {r['landing_error_max_m']:.1f}"
    ratio = f"{e.replay['torque_ratio_max']:.2f}"
    return " | ".join([*body, "yes" if e.completed else " ".join(e.missed), com, slip, ratio, hand])


def _by_experiment(title: str, caption: str, executions: dict[str, dict[str, float]]) -> Iterable[str]:
    yield f"## {title}\n"
    yield f"{caption}\n"
    yield "| | " + " | ".join(EXPERIMENTS) + " |"
    yield "| --- " * (1 + len(EXPERIMENTS)) + "|"
    for what in dict.fromkeys(what for column in executions.values() for what in column):
        values = [executions.get(name, {}).get(what) for name in EXPERIMENTS]
        yield (
            f"| {what} | "
            + " | ".join("" if v is None else "**falls**" if v < 0 else f"{v:.1f}" for v in values)
            + " |"
        )
    yield ""


if __name__ == "__main__":
    main()
