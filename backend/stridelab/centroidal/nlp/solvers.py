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

from stridelab.centroidal.dynamics import N_STATE
from stridelab.centroidal.nlp.assembly import Programme
from stridelab.centroidal.nlp.callbacks import AtCurvatures, AtIterations, Listener, Tell
from stridelab.centroidal.nlp.kkt import IterationLog, Point
from stridelab.centroidal.nlp.nlp import SCALE, Compiled
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
EVALUATIONS = 1.5
"""Upper estimate of an iteration of fatrop, per call of all its functions (0.6 to 1.4 were measured)."""
TIME_IS_UP = "maximum cputime exceeded"
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
class Run:
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


def run(
    name: SolverName,
    programme: Transcription,
    limits: Limits = DEFAULT_LIMITS,
    start: Point | None = None,
    tell: Tell | None = None,
) -> Run:
    """Solve from the initial guess or from ``start``; any failure gives a ``SolverRun`` without success.

    A start of another structure is ignored. Multipliers of the start are used by ipopt only.
    """
    compiled = programme.compiled
    warm = start if start is not None and start.structure == compiled.structure else None
    initial = warm or Point(
        compiled.structure, programme.guess, np.zeros(compiled.layout.n), np.zeros(compiled.layout.n_rows)
    )
    started = time.process_time()
    built = started
    if not np.isfinite(float(compiled.programme.value(initial.w, programme.p))):  # fatrop's line search would not end
        return Run(initial, False, False, "the cost is not a number at the start", 0, 0.0, 0.0, _log({}))
    try:
        solver = _solver(name, compiled, limits, warm is not None)
        built = time.process_time()
        solver.listener.listen(tell, programme.box)
        result = solver.function(
            x0=initial.w,
            lam_x0=initial.lambda_w,
            lam_g0=initial.lambda_g,
            p=programme.p,
            lbx=programme.box.lower,
            ubx=programme.box.upper,
            lbg=programme.box.row_lower,
            ubg=programme.box.row_upper,
        )
    except RuntimeError as failure:  # the only exception of CasADi
        message = str(failure).strip().splitlines()[-1]
        return Run(initial, False, False, message, 0, built - started, time.process_time() - built, _log({}))
    solve_s = time.process_time() - built
    stats = solver.function.stats()
    iterations = int(stats["iter_count"])
    final = [result[key].full().ravel() for key in ("x", "lam_x", "lam_g")]
    finite = all(np.isfinite(x).all() for x in final)
    status = str(stats["return_status"] if name == "ipopt" else stats["unified_return_status"])
    if name == "fatrop" and not stats["success"] and solver.fitting <= iterations < limits.iterations:
        status = TIME_IS_UP
    return Run(
        point=Point(compiled.structure, *final) if finite else initial,
        success=bool(stats["success"]) and finite,
        infeasible=status == "Infeasible_Problem_Detected",
        status=status.replace("_", " ").lower(),
        iterations=iterations,
        build_s=built - started,
        solve_s=solve_s,
        log=_log(stats.get("iterations", {}) if name == "ipopt" else {}),
    )


def _log(iterations: Mapping[str, list[float]]) -> IterationLog:
    def column(name: str) -> Float[np.ndarray, "n"]:
        return np.array(iterations.get(name, []), dtype=float)

    return IterationLog(column("obj") / SCALE, column("inf_pr"), column("inf_du"), column("mu"))


@dataclass(frozen=True, eq=False)
class _Solver:
    function: ca.Function
    listener: Listener
    ear: ca.Callback  # CasADi holds no reference to it
    fitting: int


def _solver(name: SolverName, of: Compiled, limits: Limits, warm: bool) -> _Solver:
    key = (name, limits, warm)
    if key not in of.solvers:
        listener = Listener(of.programme)
        callback = _EARS[name](listener)
        fitting = limits if name == "ipopt" else replace(limits, iterations=_fitting(of.programme, limits))
        of.solvers[key] = _Solver(_SETUP[name](of, fitting, warm, callback), listener, callback, fitting.iterations)
    solver = of.solvers[key]
    assert isinstance(solver, _Solver)
    return solver


@dataclass(frozen=True, eq=False)
class _Expressions:
    """Expressions of a nonlinear program under the names that CasADi expects."""

    programme: Programme
    x: ca.MX
    p: ca.MX
    lam_f: ca.MX
    lam_g: ca.MX

    @staticmethod
    def of(programme: Programme) -> "_Expressions":
        x, p = ca.MX.sym("x", programme.n), ca.MX.sym("p", programme.n_p)
        return _Expressions(programme, x, p, ca.MX.sym("lam_f"), ca.MX.sym("lam_g", programme.n_rows))

    @property
    def nlp(self) -> dict[str, ca.MX]:
        return {"x": self.x, "p": self.p, "f": self.f, "g": self.g}

    @property
    def f(self) -> ca.MX:
        return self.programme.value(self.x, self.p)

    @property
    def g(self) -> ca.MX:
        return self.programme.rows(self.x, self.p)

    @property
    def gradient(self) -> ca.MX:
        return self.programme.gradient(self.x, self.p)

    @property
    def jacobian(self) -> ca.MX:
        return self.programme.jacobian(self.x, self.p)

    def function(self, name: str, outputs: Mapping[str, ca.MX | ca.DM], multipliers: bool = False) -> ca.Function:
        """CasADi function with the input and output names that its solvers expect."""
        inputs = {"x": self.x, "p": self.p} | ({"lam_f": self.lam_f, "lam_g": self.lam_g} if multipliers else {})
        return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def _ipopt(of: Compiled, limits: Limits, warm: bool, ear: ca.Callback) -> ca.Function:
    e = _Expressions.of(of.programme)
    curvature = of.programme.hessian(e.x, e.p, e.lam_f, e.lam_g, 1.0)
    options: dict[str, Any] = {
        "grad_f": e.function("nlp_grad_f", {"f": e.f, "grad_f_x": e.gradient}),
        "jac_g": e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        "hess_lag": e.function("nlp_hess_l", {"triu_hess_gamma_x_x": curvature}, multipliers=True),
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
        "iteration_callback": ear,
    }
    if warm:
        options |= {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": WARM_BARRIER,
            "ipopt.warm_start_bound_push": WARM_BARRIER,
            "ipopt.warm_start_slack_bound_push": WARM_BARRIER,
            "ipopt.warm_start_mult_bound_push": WARM_BARRIER,
        }
    return ca.nlpsol("centroidal", "ipopt", e.nlp, options)


def _fatrop(of: Compiled, limits: Limits, warm: bool, ear: ca.Callback) -> ca.Function:
    """Create fatrop with explicit stages; derivatives are passed as CasADi's cache, as it has no options for them."""
    e, layout = _Expressions.of(of.programme), of.layout
    lagrangian_gradient = e.lam_f * e.gradient + e.jacobian.T @ e.lam_g
    curvature = of.programme.hessian(e.x, e.p, e.lam_f + ear(e.x, e.p), e.lam_g, 0.0)
    functions = [
        e.function("nlp_grad_f", {"grad_f_x": e.gradient}),
        e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        e.function(
            "nlp_grad",
            {"f": e.f, "g": e.g, "grad_gamma_x": lagrangian_gradient, "grad_gamma_p": ca.MX(of.programme.n_p, 1)},
            multipliers=True,
        ),
        e.function(
            "nlp_hess_l",
            {"grad_gamma_x": lagrangian_gradient, "hess_gamma_x_x": ca.triu2symm(curvature)},
            multipliers=True,
        ),
    ]
    n_intervals = len(layout.wrench)
    equality = np.ones(layout.n_rows, dtype=bool)
    for use in layout.uses:
        equality[use.row : use.row + n_cones(use.group) + n_limits(use.group)] = False
    if of.structure.capture_planes:
        equality[layout.end + N_CAPTURABLE : layout.end + N_CAPTURABLE + of.structure.capture_planes] = False
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
    return ca.nlpsol("centroidal", "fatrop", e.nlp, options)


def _fitting(of: Programme, limits: Limits) -> int:
    """Estimated number of fatrop iterations within the processor time limit."""
    w, p, multipliers = np.zeros(of.n), np.ones(of.n_p), np.zeros(of.n_rows)
    start_s = time.process_time()
    of.hessian(w, p, 1.0, multipliers, 0.0)
    for function in (of.jacobian, of.gradient, of.rows, of.value):
        function(w, p)
    iteration_s = EVALUATIONS * (time.process_time() - start_s)
    return int(max(1, min(limits.iterations, limits.cpu_s / max(iteration_s, 1e-9))))


_EARS: dict[SolverName, Callable[[Listener], ca.Callback]] = {"ipopt": AtIterations, "fatrop": AtCurvatures}
_SETUP: dict[SolverName, Callable[[Compiled, Limits, bool, ca.Callback], ca.Function]] = {
    "ipopt": _ipopt,
    "fatrop": _fatrop,
}
