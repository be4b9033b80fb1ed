"""Solving the nonlinear program with ipopt or fatrop through CasADi, without output and within limits; never raises.

Both solvers get the same functions, so that CasADi differentiates nothing, and both are cached with the compiled
program: the next problem of the same structure only changes its parameters. ipopt (adaptive barrier, MUMPS) corrects
an indefinite Hessian itself and gets the exact one of the log-densities: about 20 iterations on stairs. fatrop, which
exploits the stages, gets the majoriser; with u_f it needs three to ten times as many iterations, and its set-up time
grows faster than the number of stages (measurements in docs/theory/centroidal-problem.md).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from stridelab.centroidal.contact_wrench import N_STATE
from stridelab.centroidal.nlp.assembly import NonlinearProgram
from stridelab.centroidal.nlp.callbacks import HessianCallback, IpoptCallback, IterateReporter, IterationCallback
from stridelab.centroidal.nlp.kkt import IterationLog, Point
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE, Compiled
from stridelab.centroidal.nlp.transcription import Transcription
from stridelab.centroidal.nlp.variable_layout import N_CAPTURABLE, n_cones, n_limits

SolverName = Literal["ipopt", "fatrop"]
TOLERANCE = 1e-6
FATROP_TOLERANCE = 1e-8
"""At 1e-6 the barrier term is still significant: the objective of u_f differs by 3e-4 from that of ipopt."""
FATROP_ACCEPTABLE = 1e-5
"""Acceptable level over several iterations: with u_f the dual infeasibility decreases slowly below it."""
WARM_BARRIER = 1e-5
"""Barrier parameter of a warm start: slightly larger than that of a solution."""
EVALUATIONS_PER_ITERATION = 1.5
"""Upper estimate of an iteration of fatrop, per call of all its functions (0.6 to 1.4 were measured)."""
TIME_LIMIT_STATUS = "maximum cputime exceeded"
"""Status of a solver that reached its time limit, in ipopt's wording."""


@dataclass(frozen=True)
class Limits:
    """Solver limits: iterations and processor time (s), which does not advance while the process is paused.

    ipopt checks the time in every iteration. fatrop cannot be interrupted (docs/theory/centroidal-problem.md): its
    iterations are limited by an estimate from the time of one evaluation of its functions.
    """

    iterations: int = 300
    cpu_s: float = 60.0


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, eq=False)
class SolverRun:
    """Result of a solver: final point, ``success`` and ``status`` as reported by it, CPU seconds, log.

    ``infeasible``: the solver reports infeasible constraints, which is a proof if all constraints are linear.
    """

    point: Point
    success: bool
    infeasible: bool
    status: str
    iterations: int
    build_s: float
    solve_s: float
    log: IterationLog


def run_solver(
    name: SolverName,
    transcription: Transcription,
    limits: Limits = DEFAULT_LIMITS,
    start: Point | None = None,
    on_iteration: IterationCallback | None = None,
) -> SolverRun:
    """Solve from the initial guess or from ``start``; any failure gives a ``SolverRun`` without success.

    A start of another structure is ignored. Multipliers of the start are used by ipopt only.
    """
    compiled = transcription.compiled
    warm = start if start is not None and start.structure == compiled.structure else None
    initial = warm or Point(
        compiled.structure, transcription.guess, np.zeros(compiled.layout.n), np.zeros(compiled.layout.n_rows)
    )
    started = time.process_time()
    built = started
    if not np.isfinite(float(compiled.nlp.value(initial.w, transcription.p))):  # fatrop's line search would not end
        return SolverRun(
            initial, False, False, "the cost is not a number at the start", 0, 0.0, 0.0, _iteration_log({})
        )
    try:
        solver = _cached_solver(name, compiled, limits, warm is not None)
        built = time.process_time()
        solver.reporter.begin_run(on_iteration, transcription.box)
        result = solver.function(
            x0=initial.w,
            lam_x0=initial.lambda_w,
            lam_g0=initial.lambda_g,
            p=transcription.p,
            lbx=transcription.box.lower,
            ubx=transcription.box.upper,
            lbg=transcription.box.row_lower,
            ubg=transcription.box.row_upper,
        )
    except RuntimeError as failure:  # the only exception of CasADi
        message = str(failure).strip().splitlines()[-1]
        return SolverRun(
            initial, False, False, message, 0, built - started, time.process_time() - built, _iteration_log({})
        )
    solve_s = time.process_time() - built
    stats = solver.function.stats()
    iterations = int(stats["iter_count"])
    final = [result[key].full().ravel() for key in ("x", "lam_x", "lam_g")]
    finite = all(np.isfinite(x).all() for x in final)
    status = str(stats["return_status"] if name == "ipopt" else stats["unified_return_status"])
    if name == "fatrop" and not stats["success"] and solver.max_iterations <= iterations < limits.iterations:
        status = TIME_LIMIT_STATUS
    return SolverRun(
        point=Point(compiled.structure, *final) if finite else initial,
        success=bool(stats["success"]) and finite,
        infeasible=status == "Infeasible_Problem_Detected",
        status=status.replace("_", " ").lower(),
        iterations=iterations,
        build_s=built - started,
        solve_s=solve_s,
        log=_iteration_log(stats.get("iterations", {}) if name == "ipopt" else {}),
    )


def _iteration_log(iterations: Mapping[str, list[float]]) -> IterationLog:
    def column(name: str) -> Float[np.ndarray, "n"]:
        return np.array(iterations.get(name, []), dtype=float)

    return IterationLog(column("obj") / OBJECTIVE_SCALE, column("inf_pr"), column("inf_du"), column("mu"))


@dataclass(frozen=True, eq=False)
class _Solver:
    function: ca.Function
    reporter: IterateReporter
    callback: ca.Callback  # CasADi holds no reference to it
    max_iterations: int


def _cached_solver(name: SolverName, compiled: Compiled, limits: Limits, warm: bool) -> _Solver:
    key = (name, limits, warm)
    if key not in compiled.solvers:
        listener = IterateReporter(compiled.nlp)
        callback = _CALLBACKS[name](listener)
        fitting = (
            limits if name == "ipopt" else replace(limits, iterations=_affordable_iterations(compiled.nlp, limits))
        )
        compiled.solvers[key] = _Solver(
            _SETUP[name](compiled, fitting, warm, callback), listener, callback, fitting.iterations
        )
    solver = compiled.solvers[key]
    assert isinstance(solver, _Solver)
    return solver


@dataclass(frozen=True, eq=False)
class _Expressions:
    """Expressions of a nonlinear program under the names that CasADi expects."""

    program: NonlinearProgram
    x: ca.MX
    p: ca.MX
    lam_f: ca.MX
    lam_g: ca.MX

    @staticmethod
    def from_program(program: NonlinearProgram) -> "_Expressions":
        x, p = ca.MX.sym("x", program.n), ca.MX.sym("p", program.n_p)
        return _Expressions(program, x, p, ca.MX.sym("lam_f"), ca.MX.sym("lam_g", program.n_rows))

    @property
    def nlp_expressions(self) -> dict[str, ca.MX]:
        return {"x": self.x, "p": self.p, "f": self.f, "g": self.g}

    @property
    def f(self) -> ca.MX:
        return self.program.value(self.x, self.p)

    @property
    def g(self) -> ca.MX:
        return self.program.rows(self.x, self.p)

    @property
    def gradient(self) -> ca.MX:
        return self.program.gradient(self.x, self.p)

    @property
    def jacobian(self) -> ca.MX:
        return self.program.jacobian(self.x, self.p)

    def named_function(self, name: str, outputs: Mapping[str, ca.MX | ca.DM], multipliers: bool = False) -> ca.Function:
        """CasADi function with the input and output names that its solvers expect."""
        inputs = {"x": self.x, "p": self.p} | ({"lam_f": self.lam_f, "lam_g": self.lam_g} if multipliers else {})
        return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def _create_ipopt(compiled: Compiled, limits: Limits, warm: bool, callback: ca.Callback) -> ca.Function:
    e = _Expressions.from_program(compiled.nlp)
    curvature = compiled.nlp.hessian(e.x, e.p, e.lam_f, e.lam_g, 1.0)
    options: dict[str, Any] = {
        "grad_f": e.named_function("nlp_grad_f", {"f": e.f, "grad_f_x": e.gradient}),
        "jac_g": e.named_function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        "hess_lag": e.named_function("nlp_hess_l", {"triu_hess_gamma_x_x": curvature}, multipliers=True),
        "no_nlp_grad": True,
        "calc_lam_p": False,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.constr_viol_tol": 1e-11,  # in body weights and metres: the dynamics hold to 1e-8 N m s
        "ipopt.mu_strategy": "adaptive",
        "ipopt.mu_min": 1e-9,  # costs 0.003 of the objective and saves the last slow iterations along the cones
        "ipopt.nlp_scaling_method": "none",
        "ipopt.bound_relax_factor": 0.0,  # the cones hold exactly
        "ipopt.max_iter": limits.iterations,
        "ipopt.max_cpu_time": limits.cpu_s,
        "iteration_callback": callback,
    }
    if warm:
        options |= {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": WARM_BARRIER,
            "ipopt.warm_start_bound_push": WARM_BARRIER,
            "ipopt.warm_start_slack_bound_push": WARM_BARRIER,
            "ipopt.warm_start_mult_bound_push": WARM_BARRIER,
        }
    return ca.nlpsol("centroidal", "ipopt", e.nlp_expressions, options)


def _create_fatrop(compiled: Compiled, limits: Limits, warm: bool, callback: ca.Callback) -> ca.Function:
    """Create fatrop with explicit stages; derivatives are passed as CasADi's cache, as it has no options for them."""
    e, layout = _Expressions.from_program(compiled.nlp), compiled.layout
    lagrangian_gradient = e.lam_f * e.gradient + e.jacobian.T @ e.lam_g
    curvature = compiled.nlp.hessian(e.x, e.p, e.lam_f + callback(e.x, e.p), e.lam_g, 0.0)
    functions = [
        e.named_function("nlp_grad_f", {"grad_f_x": e.gradient}),
        e.named_function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        e.named_function(
            "nlp_grad",
            {"f": e.f, "g": e.g, "grad_gamma_x": lagrangian_gradient, "grad_gamma_p": ca.MX(compiled.nlp.n_p, 1)},
            multipliers=True,
        ),
        e.named_function(
            "nlp_hess_l",
            {"grad_gamma_x": lagrangian_gradient, "hess_gamma_x_x": ca.triu2symm(curvature)},
            multipliers=True,
        ),
    ]
    n_intervals = len(layout.wrench)
    equality = np.ones(layout.n_rows, dtype=bool)
    for use in layout.uses:
        equality[use.row : use.row + n_cones(use.group) + n_limits(use.group)] = False
    if compiled.structure.capture_planes:
        equality[layout.end + N_CAPTURABLE : layout.end + N_CAPTURABLE + compiled.structure.capture_planes] = False
    options: dict[str, Any] = {
        "cache": {function.name(): function for function in functions},
        "structure_detection": "manual",
        "N": n_intervals,
        "nx": [N_STATE] * (n_intervals + 1),
        "nu": [*(np.diff(layout.state) - N_STATE).tolist(), 0],
        "ng": list(layout.stage_rows),
        "equality": equality.tolist(),
        "print_time": False,
        "calc_lam_p": False,
        "fatrop.print_level": 0,
        "fatrop.tol": FATROP_TOLERANCE,
        "fatrop.tol_acceptable": FATROP_ACCEPTABLE,
        "fatrop.mu_init": 1e-2,
        "fatrop.barrier_tol_factor": 1e3,  # reduce the barrier parameter before the dual infeasibility stagnates
        "fatrop.mu_superlinear_decrease_power": 1.2,
        "fatrop.max_iter": limits.iterations,
    }
    return ca.nlpsol("centroidal", "fatrop", e.nlp_expressions, options)


def _affordable_iterations(nlp: NonlinearProgram, limits: Limits) -> int:
    """Estimated number of fatrop iterations within the processor time limit."""
    w, p, multipliers = np.zeros(nlp.n), np.ones(nlp.n_p), np.zeros(nlp.n_rows)
    start_s = time.process_time()
    nlp.hessian(w, p, 1.0, multipliers, 0.0)
    for function in (nlp.jacobian, nlp.gradient, nlp.rows, nlp.value):
        function(w, p)
    iteration_s = EVALUATIONS_PER_ITERATION * (time.process_time() - start_s)
    return int(max(1, min(limits.iterations, limits.cpu_s / max(iteration_s, 1e-9))))


_CALLBACKS: dict[SolverName, Callable[[IterateReporter], ca.Callback]] = {
    "ipopt": IpoptCallback,
    "fatrop": HessianCallback,
}
_SETUP: dict[SolverName, Callable[[Compiled, Limits, bool, ca.Callback], ca.Function]] = {
    "ipopt": _create_ipopt,
    "fatrop": _create_fatrop,
}
