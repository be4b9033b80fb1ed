"""Numbers in the text of chapter 4: robots, densities, cones and their factors, durations, solver times.

The figures and the table have their own items.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial import ConvexHull

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.receding_horizon import RecedingHorizon
from stridelab.centroidal.solver import solve
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.ellipsoids import smallest_around
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone
from stridelab.conventions import Progress
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.store import load_cloud
from stridelab.reproduction.chapter4.table_4_1 import COLUMNS, THESIS_SOLVER
from stridelab.reproduction.claims import (
    DETERMINISTIC,
    Claim,
    Measured,
    Reproduction,
    at_least,
    at_most,
    reproduces,
    target,
    within,
)
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.random_contact_sets import random_contacts, stair_sets
from stridelab.reproduction.studies.thesis_experiments import Experiment, experiment_problem
from stridelab.robots.loader import load_robot
from stridelab.robots.visuals import link_meshes

DIMENSION: Final = 5
"""Dimension of the section of a wrench cone."""
CLOUDS: Final = 10
POINTS: Final = 20
SETS: Final = 1000
"""Random contact sets per number of bodies; with 2 bodies, half of them have some 50 facets and half some 140."""
FACETS: Final = {2: (50.0, "about 50"), 3: (100.0, "more than 100")}
KINDS: Final = ("general", "symmetric")
"""Clouds of points: any, and with the opposite of each point."""
UNSTABLE: Final = 1e-6
"""Relative violation of a facet up to which it is exact but for rounding."""
KERNEL_NS: Final = 10.0
N_EVALUATIONS: Final = 200
REPEATS: Final = 3
SOLVER: Final = "ipopt"
"""One solver for both controls."""
HORIZON_S: Final = 3.0
REPLANS: Final = 6
RATE_HZ: Final = 20.0
MOTIONS_S: Final[dict[Experiment, float]] = {1: 8.0, 2: 24.0, 3: 36.0}
PER_SECOND_S: Final = 0.015
DURATION_TOLERANCE: Final = 0.02
"""Relative tolerance of a printed duration against the sum of its phases."""
AROUND_TOLERANCE: Final = 0.1
"""Relative tolerance for "around"."""


@dataclass(frozen=True)
class FacetCounts:
    """Number of facets of random contact sets, and largest relative violation of a facet by a ray of each."""

    facets: tuple[float, ...]
    violations: tuple[float, ...]

    @property
    def median_number(self) -> float:
        """Median number of facets."""
        return float(np.median(self.facets))

    @property
    def largest_violation(self) -> float:
        """Largest violation of all sets."""
        return max(self.violations)


@reproduces("numbers-4", "Numbers in the text of chapter 4", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """Deterministic except for the times."""
    tell(0.05, "robots")
    claims = list(_robot_claims())
    tell(0.3, "cones")
    facets = {bodies: facet_counts(bodies, seeds[0]) for bodies in FACETS}
    alphas = {kind: shrinking_factors(symmetric=kind == "symmetric", seed=seeds[0]) for kind in KINDS}
    claims += [*_facet_claims(facets), *_john_claims(alphas)]
    tell(0.5, "densities")
    claims.append(_kernel_claim())
    tell(0.6, "solving")
    claims += [*_duration_claims(), *_solve_time_claims()]
    return Reproduction(
        claims=tuple(claims),
        note="Times are processor times of one thread of this machine. Facets are those of pyramids with four rays per "
        "contact point, without duplicates.",
        tables={
            "facets": {
                "bodies": np.array(list(facets)),
                "median_facets": np.array([counts.median_number for counts in facets.values()]),
                "largest_violation": np.array([counts.largest_violation for counts in facets.values()]),
            },
            "alpha": {"clouds": np.array(KINDS), "least_alpha": np.array([min(alphas[kind]) for kind in KINDS])},
        },
        drawing=render_svg(
            Bars(
                "Facets of the cone of wrenches, median of random sets",
                "1",
                [(f"{bodies} contacts", counts.median_number) for bodies, counts in facets.items()],
            ),
            Bars("Smallest alpha inside", "1", [(kind, min(alphas[kind])) for kind in KINDS]),
        ),
    )


def height_m(robot_name: str) -> float:
    """Height of the robot from its meshes with all joints at zero, i.e. upright with straight legs."""
    robot = load_robot(robot_name)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    z_m = [
        mesh.vertices_m @ placed.rotation[2] + placed.translation[2]
        for mesh, placed in zip(link_meshes(robot), list(data.oMi)[1:], strict=True)
        if len(mesh.vertices_m)
    ]
    return max(float(z.max()) for z in z_m) - min(float(z.min()) for z in z_m)


def facet_counts(bodies: int, seed: int = 0) -> FacetCounts:
    """Facets of ``SETS`` random contact sets with ``bodies`` contacts."""
    rng = np.random.default_rng(bodies + 10 * seed)
    cones = [LinearCone.from_contacts(random_contacts(rng, bodies), 4) for _ in range(SETS)]
    return FacetCounts(
        tuple(float(len(cone.normals)) for cone in cones), tuple(_largest_violation(cone) for cone in cones)
    )


def shrinking_factors(*, symmetric: bool, seed: int = 0) -> list[float]:
    """Factors by which the smallest ellipsoid around a random point cloud shrinks to lie in its hull, one per cloud.

    The last cloud is the one for which John's theorem is sharp: a simplex or a cross-polytope.
    """
    rng = np.random.default_rng(seed)
    corners = np.eye(DIMENSION)
    clouds = [*(rng.standard_normal((POINTS, DIMENSION)) for _ in range(CLOUDS)), corners]
    if symmetric:
        return [_shrinking_factor(np.vstack([cloud, -cloud])) for cloud in clouds]
    return [_shrinking_factor(cloud) for cloud in [*clouds[:-1], np.vstack([corners, -np.ones(DIMENSION)])]]


def _shrinking_factor(cloud: Float[np.ndarray, "n d"]) -> float:
    around, hull = smallest_around(cloud), ConvexHull(cloud, qhull_options="Qt Qx")
    normals, offsets = hull.equations[:, :-1], -hull.equations[:, -1]
    return float(((offsets - normals @ around.center) / np.linalg.norm(normals @ around.axes, axis=1)).min())


def _largest_violation(cone: LinearCone) -> float:
    rays = cone.rays / np.linalg.norm(cone.rays, axis=1, keepdims=True)
    facets = cone.facets / np.linalg.norm(cone.facets, axis=1, keepdims=True)
    return float((rays @ facets.T).max())


def _robot_claims() -> tuple[Claim, ...]:
    """Claims of 4.6.2 and 4.6.4 on the sizes of the robots."""
    heights_m = (("hrp2", "HRP-2", 1.6, "4.6.2"), ("talos", "TALOS", 1.78, "4.6.4"))
    return (
        *(
            _around_claim(
                f"{name}_height_m", f"{title} is {height:g} m high", height, height_m(name), "m",
                "With the joints at zero.", where,
            )
            for name, title, height, where in heights_m
        ),
        _around_claim(
            "talos_mass_kg", "TALOS weighs around 100 kg", 100.0, load_robot("talos").mass_kg, "kg",
            "According to its description.", "4.6.4",
        ),
    )  # fmt: skip


def _around_claim(key: str, says: str, thesis: float, ours: float, unit: str, note: str, where: str) -> Claim:
    return Measured(
        key, thesis, ours, unit, within((1.0 - AROUND_TOLERANCE) * thesis, (1.0 + AROUND_TOLERANCE) * thesis, "ours")
    ).says(says, note, evidence="external", **DETERMINISTIC, where=where)


def _facet_claims(facets: dict[int, FacetCounts]) -> tuple[Claim, ...]:
    """Claims of 4.4.1 on the double description."""
    stairs = [(name, len(LinearCone.from_contacts(contacts, 4).normals)) for name, contacts in _stair_contact_sets()]
    on_stairs = "Figure 4.5's stances: " + ", ".join(f"{n} with {name}" for name, n in stairs) + "."
    two, three = (facets[bodies].median_number for bodies in (2, 3))
    violations = [violation for counts in facets.values() for violation in counts.violations]
    return (
        Measured("facets_2", FACETS[2][0], two, "1", within(0.5 * FACETS[2][0], 2.0 * FACETS[2][0], "ours")).says(
            "about 50 inequalities with 2 contacts",
            f"Median of {SETS} random sets. {on_stairs}",
            n=SETS,
            interval=interval_of(facets[2].facets, np.median),
            where="4.4.1",
        ),
        Measured("facets_3", FACETS[3][0], three, "1", at_least(FACETS[3][0], "thesis")).says(
            "more than 100 inequalities with 3 contacts",
            f"Median of {SETS} random sets.",
            n=SETS,
            interval=interval_of(facets[3].facets, np.median),
            where="4.4.1",
        ),
        target("facets_violation", max(violations), "1", at_most=UNSTABLE).says(
            "facets of 3 contacts and more are exact up to rounding: largest relative violation by a ray",
            "Computed as the hull of a whitened section (qhull). The thesis calls a double description numerically "
            "unstable there, which is not tried here.",
            n=len(violations),
            cases_inside=sum(violation <= UNSTABLE for violation in violations),
        ),
    )


def _stair_contact_sets() -> Sequence[tuple[str, PointContacts]]:
    return list(stair_sets("hrp2").items())[:2]


def _john_claims(alphas: Mapping[str, Sequence[float]]) -> tuple[Claim, ...]:
    """Claims of 4.4.3 on the shrinking factor of the smallest enclosing ellipsoid."""
    fifth, root = 1.0 / DIMENSION, 1.0 / np.sqrt(DIMENSION)

    def bound_claim(key: str, kind: str, bound: float, says: str, sharp: str) -> Claim:
        of, holds = alphas[kind], at_least(bound - 1e-6, "thesis")
        return Measured(key, bound, min(of), "1", holds).says(
            says, note.format(sharp), n=len(of), cases_inside=sum(map(holds.contains, of)), where="4.4.3"
        )

    note = f"Minimum over {CLOUDS} clouds of {POINTS} points and {{}}, for which the bound is sharp. For the ellipsoid "
    note += "of step (ii); that of step (iv) has another centre (figure 4.6)."
    return (
        bound_claim("john", "general", fifth, "an ellipsoid divided by 5 is inside the hull", "the simplex"),
        bound_claim(
            "john_symmetric", "symmetric", root, "a symmetric ellipsoid divided by √5 is inside the hull",
            "the cross-polytope",
        ),
    )  # fmt: skip


def _kernel_claim() -> Claim:
    """Claim of 4.3.2.2 on the evaluation time of a kernel."""
    cloud = load_cloud("hrp2", "uniform")["right_foot"]
    kernels = KernelDensity.with_scott_bandwidth(cloud)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        kernels.log_density(cloud[:N_EVALUATIONS])
        times.append(time.process_time() - began)
    each_ns = 1e9 * min(times) / (N_EVALUATIONS * len(cloud))
    return Measured(
        "kernel_ns",
        KERNEL_NS,
        each_ns,
        "ns",
        at_most(2.0 * KERNEL_NS, "ours", better_than=0.5 * KERNEL_NS),
    ).says(
        "a kernel of the density takes around 10 ns",
        f"Distance and exponential, {len(cloud)} kernels at {N_EVALUATIONS} points; least of {REPEATS}.",
        n=REPEATS,
        no_interval="machine_time",
        where="4.3.2.2",
    )


def _duration_claims() -> tuple[Claim, ...]:
    """Durations of table 4.1 compared with the phases of 4.6.3 and 4.6.4."""
    claims = []
    for experiment, printed_s in MOTIONS_S.items():
        ours_s = experiment_problem(experiment, "hrp2").sequence.duration_s
        claims.append(
            Measured(
                f"motion_{experiment}_s",
                printed_s,
                ours_s,
                "s",
                within((1.0 - DURATION_TOLERANCE) * printed_s, (1.0 + DURATION_TOLERANCE) * printed_s, "ours"),
            ).says(
                f"experiment {experiment} lasts {printed_s:g} s",
                "Sum of the phases.",
                **DETERMINISTIC,
                where="table 4.1",
            )
        )
    return tuple(claims)


def _solve_time_claims() -> tuple[Claim, ...]:
    """Claims of 4.6.1 and 4.8 on solver times."""
    own_ms = max(1e3 * c.time_s / c.iterations / c.duration_s for c in COLUMNS if np.isfinite(c.time_s))
    walk = experiment_problem(1, "hrp2")
    replans = list(islice(RecedingHorizon(problem=walk, horizon_s=HORIZON_S).iterate_replans(None), REPLANS))
    rate_hz = 1.0 / float(np.median([replan.took_s / replan.iterations for replan in replans]))
    whole_ms = 1e3 * float(np.median([replan.took_s for replan in replans]))
    stairs = experiment_problem(2, "hrp2")
    wrench, forces = (
        min(p.solve_time_s / p.iterations / p.time_s[-1] for p in [solve(case, SOLVER) for _ in range(REPEATS)])
        for case in (replace(stairs, control=ContactWrench()), stairs)
    )
    return (
        Measured(
            "per_second_s",
            PER_SECOND_S,
            own_ms / 1e3,
            "s",
            at_most(PER_SECOND_S + 0.0005, "thesis", otherwise="thesis_in_error"),
        ).says(
            "one iteration for one second of motion takes 7 to 15 ms, according to table 4.1",
            "Largest value of the table's columns: that of experiment 3. Half of the last printed digit is allowed. "
            "Ours is in the item table-4.1.",
            n=sum(bool(np.isfinite(c.time_s)) for c in COLUMNS),
            evidence="external",
            no_interval="deterministic",
            where="4.6.1",
        ),
        Measured(
            "horizon_hz",
            RATE_HZ,
            rate_hz,
            "Hz",
            at_least(RATE_HZ, "thesis", better_than=1.5 * RATE_HZ),
        ).says(
            "with a horizon of 2 to 3 s the solver makes one iteration at 20 Hz",
            f"Experiment 1 with u_f over {HORIZON_S:g} s, including the construction of the nonlinear program; "
            f"median of {REPLANS} replans, each solved to convergence in {whole_ms:.0f} ms.",
            n=REPLANS,
            no_interval="machine_time",
            solver=replans[0].plan.solver,
            comparator=THESIS_SOLVER,
            where="4.6.1",
        ),
        Measured("wrench_25_s", 0.2, 25.0 * wrench, "s", at_most(0.2, "thesis", better_than=0.2)).says(
            "u_c: near 0.2 s for 25 s of motion",
            "One iteration of experiment 2, for 25 s.",
            n=REPEATS,
            no_interval="machine_time",
            solver=SOLVER,
            comparator=THESIS_SOLVER,
            where="4.8",
        ),
        Measured("forces_17_s", 0.4, 17.0 * forces, "s", at_most(0.4, "thesis", better_than=0.4)).says(
            "u_f: near 0.4 s for 17 s of motion",
            "One iteration of experiment 2, for 17 s. By table 4.1 (97 ms for 8 s) it would be 0.21 s.",
            n=REPEATS,
            no_interval="machine_time",
            solver=SOLVER,
            comparator=THESIS_SOLVER,
            where="4.8",
        ),
    )
