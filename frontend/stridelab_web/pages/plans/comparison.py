"""Comparison of two plans: their figures side by side, and why some of these cannot be compared."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stridelab.schemas.plans import CertificateSummary, PlanMotionSummary, ReplaySummary
from stridelab_web.formatting import check_name, code_words, with_unit
from stridelab_web.pages.plans.cost_table import REGULARISERS, WRENCH, cost_text, in_order, term_name, weight_of
from stridelab_web.parquet import Columns
from stridelab_web.scene.plan_frames import com_m

DASH: Final = "–"
SAME_S: Final = 1e-6
ROUNDING: Final = 1e-12
OTHER_WEIGHTS: Final = "with another weight"
AFTERWARDS: Final = "minimised in one only"


@dataclass(frozen=True)
class PlanFacts:
    """A finished plan: the input of its job and its summary."""

    input: Mapping[str, Any]
    summary: PlanMotionSummary

    @property
    def has_wrench_control(self) -> bool:
        """Whether its control is the wrench."""
        return self.summary.formulation == WRENCH

    @property
    def control_name(self) -> str:
        """Name of its control."""
        return code_words(self.summary.formulation or "forces") + (
            " as splines" if self.summary.shape == "cubic" else ""
        )

    @property
    def measure_name(self) -> str:
        """Measure of its densities; empty if unknown."""
        return self.summary.measure or str(self.input.get("measure") or "")

    def measures_differ(self, other: "PlanFacts") -> bool:
        """Whether both measures are known and differ."""
        return bool(self.measure_name and other.measure_name) and self.measure_name != other.measure_name


@dataclass(frozen=True)
class PairRow:
    """A figure of both plans as text, the first minus the second, and a note if they cannot be compared.

    Rows of one section have the same ``group``.
    """

    key: str
    name: str
    first: str
    second: str
    difference: str
    note: str = ""
    group: str = ""


def pair_remarks(first: PlanFacts, second: PlanFacts) -> list[str]:
    """Remarks to read before comparing figures."""
    a, b = first.summary, second.summary
    remarks = []
    if a.robot != b.robot:
        remarks.append(f"The robots differ, {a.robot} and {b.robot}: their masses and densities do too.")
    if a.scenario_name != b.scenario_name:
        remarks.append(f"The scenarios differ: {a.scenario_name} and {b.scenario_name}.")
    if abs(a.duration_s - b.duration_s) > SAME_S:
        remarks.append(
            f"The motions last {a.duration_s:.2f} s and {b.duration_s:.2f} s: costs are sums over time and cannot be "
            "compared, and the curves of the shorter one end earlier."
        )
    chosen = [which for which, plan in (("this", a), ("the other", b)) if plan.phase_durations is not None]
    if chosen:
        remarks.append(f"In {' and '.join(chosen)} plan the solver chose the durations of the phases.")
    if first.measures_differ(second):
        remarks.append(
            f"The densities differ ({first.measure_name} and {second.measure_name}): likelihoods, and with them "
            "the objective, "
            "cannot be compared."
        )
    if first.control_name != second.control_name:
        remarks.append(
            f"The controls differ ({first.control_name} and {second.control_name}): the objective (4.20a) is "
            "the same formula "
            "for both, but each keeps the forces in cones of its own, so that the optima need not agree."
        )
    if first.has_wrench_control != second.has_wrench_control:
        remarks.append("The cost of the forces was minimised only in the plan whose control is the forces.")
    return remarks


def pair_rows(first: PlanFacts, second: PlanFacts) -> list[PairRow]:
    """Rows of costs, solution, certificate and replay, each a group."""
    a, b = first.summary, second.summary
    no_costs_note = _no_costs_note(first, second)
    costs = [
        _cost_row(
            "objective", "Objective (4.20a)", a.objective, b.objective, no_costs_note or _objective_note(first, second)
        )
    ]
    for key in in_order({**a.cost_terms, **b.cost_terms}):
        note = no_costs_note or _term_note(key, first, second)
        costs.append(_cost_row(key, term_name(key), a.cost_terms.get(key), b.cost_terms.get(key), note))
    solution = [
        _text_row("control", "Control", first.control_name, second.control_name),
        _number_row("node_rate_hz", "Nodes per second", a.node_rate_hz, b.node_rate_hz, ""),
        _text_row("solver", "Solver", a.solver, b.solver),
        _number_row("iterations", "Iterations", a.iterations, b.iterations, ""),
        _number_row("solve_time_s", "Solved in", a.solve_time_s, b.solve_time_s, "s"),
        _number_row("build_time_s", "Built in", a.build_time_s, b.build_time_s, "s"),
        _number_row("kkt_error", "Violation of the first-order conditions", a.kkt_error, b.kkt_error, ""),
        _number_row("duration_s", "Motion", a.duration_s, b.duration_s, "s"),
    ]
    groups = {
        "Cost": costs,
        "Solution": solution,
        "Certificate": _certificate_rows(a, b),
        "Replay in physics": _replay_rows(a, b),
    }
    return [replace(row, group=group) for group, rows in groups.items() for row in rows]


def max_com_distance(first: Columns, second: Columns) -> tuple[float, float]:
    """Largest distance between two paths of the centre of mass (m) while both last, and when (s)."""
    end_s = min(first["time_s"][-1], second["time_s"][-1])
    time_s = np.unique(np.concatenate([columns["time_s"] for columns in (first, second)]))
    time_s = time_s[time_s <= end_s]
    distance_m = np.linalg.norm(com_m(first, time_s) - com_m(second, time_s), axis=1)
    k = int(np.argmax(distance_m))
    return float(distance_m[k]), float(time_s[k])


def _no_costs_note(first: PlanFacts, second: PlanFacts) -> str:
    """Reason why no costs of the two can be compared, or empty."""
    a, b = first.summary, second.summary
    if a.robot != b.robot:
        return "of another robot"
    return "over another time" if abs(a.duration_s - b.duration_s) > SAME_S else ""


def _objective_note(first: PlanFacts, second: PlanFacts) -> str:
    a, b = first.summary.weights, second.summary.weights
    weighed = (key for key in ("com_acceleration", "momentum_rate", "likelihood") if a and b)
    if any(getattr(a, key) != getattr(b, key) for key in weighed):
        return OTHER_WEIGHTS
    return "of other densities" if first.measures_differ(second) else ""


def _term_note(key: str, first: PlanFacts, second: PlanFacts) -> str:
    a, b = first.summary.weights, second.summary.weights
    if weight_of(key, a) != weight_of(key, b):
        return OTHER_WEIGHTS
    if key in REGULARISERS:
        return AFTERWARDS if first.has_wrench_control != second.has_wrench_control else ""
    if key in ("com_acceleration", "momentum_rate"):
        return ""
    return "of other densities" if first.measures_differ(second) else ""


def _certificate_rows(a: PlanMotionSummary, b: PlanMotionSummary) -> Iterator[PairRow]:
    first, second = a.certificate, b.certificate
    if first is None and second is None:
        return
    yield _text_row("certificate", "Verdict", _certificate_outcome(first), _certificate_outcome(second))
    if first is None or second is None:
        return
    first_checks, second_checks = ({check.name: check for check in each.checks} for each in (first, second))
    for name in {**first_checks, **second_checks}:
        a_check, other = first_checks.get(name), second_checks.get(name)
        unit = (a_check or second_checks[name]).unit
        yield _number_row(
            name, check_name(name), a_check.value if a_check else None, other.value if other else None, unit
        )


def _certificate_outcome(certificate: CertificateSummary | None) -> str:
    return DASH if certificate is None else "passed" if certificate.passed else "not passed"


def _replay_rows(a: PlanMotionSummary, b: PlanMotionSummary) -> Iterator[PairRow]:
    first, second = a.replay, b.replay
    if first is None and second is None:
        return
    yield _text_row("replay", "Outcome", _replay_outcome(first), _replay_outcome(second))
    if first is None or second is None:
        return
    for key, name, unit in _REPLAYED:
        mine, theirs = getattr(first, key), getattr(second, key)
        if mine is not None or theirs is not None:
            yield _number_row(f"replay.{key}", name, mine, theirs, unit)


def _replay_outcome(replay: ReplaySummary | None) -> str:
    if replay is None:
        return DASH
    return "falls" if replay.fall_time_s is not None else "completed" if replay.completed else "not completed"


_REPLAYED: Final = (
    ("fall_time_s", "Falls at", "s"),
    ("com_error_max_m", "CoM error, largest", "m"),
    ("foot_slip_max_m", "Foot slip, largest", "m"),
    ("landing_error_max_m", "Landing error, largest", "m"),
    ("hand_force_mean_n", "Hand force, mean", "N"),
    ("torque_ratio_max", "Torque, share of limit", ""),
    ("collisions", "Colliding pairs", ""),
)


def _cost_row(key: str, name: str, a: float | None, b: float | None, note: str) -> PairRow:
    difference = DASH if a is None or b is None or note else "0" if a == b else cost_text(a - b, "+")
    return PairRow(key, name, _or_dash(a, cost_text), _or_dash(b, cost_text), difference, note)


def _number_row(key: str, name: str, a: float | None, b: float | None, unit: str) -> PairRow:
    def format_value(value: float) -> str:
        return with_unit(value, unit)

    difference = "0"
    if a is None or b is None:
        difference = DASH
    elif not math.isclose(a, b, rel_tol=ROUNDING):
        difference = f"{'+' if a > b else ''}{format_value(a - b)}"
    return PairRow(key, name, _or_dash(a, format_value), _or_dash(b, format_value), difference)


def _or_dash(value: float | None, format_value: Callable[[float], str]) -> str:
    return DASH if value is None else format_value(value)


def _text_row(key: str, name: str, a: str, b: str) -> PairRow:
    return PairRow(key, name, a, b, "" if a == b or DASH in (a, b) else "differs")
