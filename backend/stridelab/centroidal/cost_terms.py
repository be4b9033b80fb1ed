"""The terms of (4.20a) and of the regularisers, recomputed in NumPy from the solution."""

from collections.abc import Mapping

import numpy as np

from stridelab.centroidal.force_splines import N_GAUSS, gauss_rule
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion, interval_states, total_force_n, wrenches_of
from stridelab.conventions import Series, g


def cost_terms(problem: CentroidalProblem, motion: Motion) -> Mapping[str, float]:
    """Every term by its name; log-densities per effector by the trapezoidal rule over each interval.

    The effort of splines is that of their inner control points, which for evenly spaced nodes is an upper bound of the
    effort of the curves.
    """
    h = np.diff(motion.time_s)
    weights = problem.weights
    a, l_rate = _squared_rates(problem, motion)
    terms = {
        "com_acceleration": weights.com_acceleration * float(h @ a),
        "momentum_rate": weights.momentum_rate * float(h @ l_rate),
        **{
            f"log_density_{name}": weights.likelihood * value
            for name, value in _log_density_terms(problem, motion).items()
        },
        **{
            f"log_density_rates_{name}": weights.likelihood * value
            for name, value in _state_density_terms(problem, motion).items()
        },
        "surface_force": 0.0,
        "point_force": 0.0,
    }
    if problem.durations is not None and problem.durations.price_per_s:
        terms["duration"] = problem.durations.price_per_s * float(h.sum())
    effort_n = {name: curve[:, 1:3] for name, curve in motion.curves_n.items()} or motion.controls_n
    for name, f in effort_n.items():
        kind = "surface_force" if problem.effectors[name].kind == "surface" else "point_force"
        squares = ((f / problem.weight_n) ** 2).sum(axis=(2, 3)).mean(axis=1)
        terms[kind] += problem.force_weight(name) * float(h @ squares)
    return terms


def _squared_rates(problem: CentroidalProblem, motion: Motion) -> tuple[Series, Series]:
    """``|c'' - a|^2`` and ``|L_c' - r|^2`` per interval.

    Constant forces: from the mean rate of L_c. Splines: by the Gauss rule of the nonlinear program. The momentum rate
    of the limbs and the reference acceleration are subtracted.
    """
    n = len(motion.phase)
    limbs_nm = np.zeros((n, N_GAUSS, 3)) if problem.limbs_nm is None else problem.limbs_nm.reshape(n, -1, 3)
    reference = (
        np.zeros((n, N_GAUSS, 3)) if problem.reference_m_s2 is None else problem.reference_m_s2.reshape(n, -1, 3)
    )
    if not motion.curves_n:
        a = total_force_n(motion) / problem.mass_kg + g - reference[:, 0]
        l_rate = np.diff(motion.l_nms, axis=0) / np.diff(motion.time_s)[:, None] - limbs_nm[:, 0]
        return (a**2).sum(axis=1), (l_rate**2).sum(axis=1)
    a_squared, l_squared = np.zeros(n), np.zeros(n)
    wrenches = wrenches_of(problem.sequence, motion)
    for k, (s, w) in enumerate(gauss_rule(N_GAUSS)):
        now = interval_states(problem.mass_kg, motion, wrenches, s)
        a_squared += w * ((now.com_a_m_s2 - reference[:, k]) ** 2).sum(axis=1)
        l_squared += w * ((now.l_rate_nm - limbs_nm[:, k]) ** 2).sum(axis=1)
    return a_squared, l_squared


def _state_density_terms(problem: CentroidalProblem, motion: Motion) -> dict[str, float]:
    """``-int log p_i(c', L) + log p_i(c'', L') dt`` per effector while it touches, by the rule of the program."""
    if not problem.state_densities:
        return {}
    sums: dict[str, float] = {}
    h = np.diff(motion.time_s)
    a = total_force_n(motion) / problem.mass_kg + g
    velocities = np.hstack([motion.com_v_m_s, motion.l_nms])[:-1]
    rates = np.hstack([a, np.diff(motion.l_nms, axis=0) / h[:, None]])
    for i, phase in enumerate(problem.sequence.phases):
        here = motion.phase == i
        for name, contact in phase.contacts.items():
            if name in problem.state_densities:
                density = problem.state_densities[name]
                logp = density.log_density(velocities[here], rates[here], contact.placement.rotation)
                sums[name] = sums.get(name, 0.0) - float(h[here] @ logp.sum(axis=1))
    return sums


def _log_density_terms(problem: CentroidalProblem, motion: Motion) -> dict[str, float]:
    """``-int log p_i(c) dt`` per effector while it touches."""
    sums: dict[str, float] = {}
    h = np.diff(motion.time_s)
    for i, phase in enumerate(problem.sequence.phases):
        intervals = np.flatnonzero(motion.phase == i)
        seconds = h[intervals] / 2
        for name, contact in phase.contacts.items():
            if name not in problem.proxies:
                continue
            com_m = motion.com_m[intervals[0] : intervals[-1] + 2]
            heading_rad = float(problem.sequence.headings_rad[i])
            logp = problem.proxies[name].log_density(com_m, contact.placement, heading_rad)
            sums[name] = sums.get(name, 0.0) - float(seconds @ (logp[:-1] + logp[1:]))
    return sums
