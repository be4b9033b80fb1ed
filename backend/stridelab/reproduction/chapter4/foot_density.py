"""Figures 4.2 and 4.4: density of the CoM over the right foot of HRP-2 and TALOS, and mixtures of several sizes.

All is computed from the first 5000 of the 20 000 bundled samples of the robot; EM uses four fifths of them, and the
bandwidth is that under which the last fifth is most likely. Figure 4.3 has the same densities of all effectors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Progress
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.fit import (
    HELD_OUT_RECIPROCAL,
    Divergence,
    expectation_maximisation,
    kl_divergences,
)
from stridelab.reachability.learning.kde import CANDIDATES_M, KernelDensity
from stridelab.reachability.proxy.projections import grid_around, project_kernels, project_mixture
from stridelab.reachability.store import load_cloud
from stridelab.reproduction.claims import (
    Claim,
    Measured,
    Reproduction,
    above,
    at_least,
    at_most,
    below,
    reproduces,
    target,
)
from stridelab.reproduction.common.intervals import resampled_interval, share_interval
from stridelab.reproduction.report.svg_density_maps import Row, hull_area_share, svg_maps

EFFECTOR: Final = "right_foot"
MASSES: Final = (0.5, 0.8, 0.95)
CONVEX_AREA_SHARE: Final = 0.9
"""Share of the convex hull below which an area counts as not convex; a disc of cells has 0.97."""
SIZES: Final = range(1, 21)
"""Numbers of components of figure 4.3."""
SUFFICIENT_SHARE: Final = 0.1
"""Share of the fall from one component to the smallest divergence that may be left where it stagnates."""
DRAWS: Final = 10_000
STANDARD_ERRORS_95: Final = 1.96
SAMPLING_ERROR: Final = 2.0 * float(np.sqrt(0.95 * 0.05 / DRAWS))
"""Two standard errors of a share of 0.95 of the draws."""
REFERENCES: Final = (
    "carpentier2017thesis",
    "carpentier2018multicontact",
    "dempster1977em",
    "hershey2007kl",
    "scott1992density",
    "pedregosa2011sklearn",
)


@dataclass(frozen=True, eq=False)
class FootDensity:
    """Kernel density and mixtures by number of components; ``held_out`` are samples not used by EM."""

    kernels: KernelDensity
    held_out: Points
    mixtures: Mapping[int, Mixture]

    def compute_divergences(self, seed: int) -> "SizeDivergences":
        """The divergence of every mixture from the kernel density, from the same draws."""
        rng = np.random.default_rng(seed)
        found = kl_divergences(self.kernels, list(self.mixtures.values()), DRAWS, rng)
        return SizeDivergences(dict(zip(self.mixtures, found, strict=True)))


@dataclass(frozen=True)
class SizeDivergences:
    """Divergence by number of components, 1 among them."""

    of_size: Mapping[int, Divergence]

    @property
    def least(self) -> int:
        """Number of components with the smallest divergence."""
        return min(self.of_size, key=lambda size: self.of_size[size].kl_nats)

    def excess_share(self, size: int) -> float:
        """What is left at ``size`` of the fall from one component to the smallest divergence."""
        least_nats = self.of_size[self.least].kl_nats
        return (self.of_size[size].kl_nats - least_nats) / (self.of_size[1].kl_nats - least_nats)

    def excess_interval(self, size: int) -> tuple[float, float]:
        """95 % interval of that share, by the standard error of the difference in the numerator."""
        fall_nats = self.of_size[1].kl_nats - self.of_size[self.least].kl_nats
        half = STANDARD_ERRORS_95 * self.of_size[size].excess_sd_nats / fall_nats
        return self.excess_share(size) - half, self.excess_share(size) + half

    def make_columns(self, sizes: Sequence[int]) -> dict[str, Float[np.ndarray, "_"]]:
        """A table of some sizes."""
        rows = [(size, *astuple(self.of_size[size])) for size in sizes]
        names = ("components", "kl_nats", "kl_sd_nats", "excess_sd_nats")
        return {
            name: np.array(column, dtype=float) for name, column in zip(names, zip(*rows, strict=True), strict=True)
        }


@reproduces("fig-4.2", "Where the CoM of HRP-2 is over its right foot", draws="one", printed=("level_sets",))
def hrp2_foot_density(seeds: range, tell: Progress) -> Reproduction:
    """Kernels, and mixtures of 5, 7 and 13 components from the bundled samples."""
    return reproduce_foot_density("hrp2", "HRP-2", (5, 7, 13), 7, seeds[0], tell)


@reproduces("fig-4.4", "Where the CoM of TALOS is over its right foot", draws="one", printed=("level_sets",))
def talos_foot_density(seeds: range, tell: Progress) -> Reproduction:
    """Kernels, and mixtures of 4 and 7 components from the bundled samples."""
    return reproduce_foot_density("talos", "TALOS", (4, 7), 4, seeds[0], tell)


def effector_density(robot: str, effector: str, seed: int = 0) -> FootDensity:
    """Kernel density and mixtures of all ``SIZES`` for the uniform measure, as in the thesis."""
    com_m = load_cloud(robot, "uniform")[effector]
    n = len(com_m) - len(com_m) // HELD_OUT_RECIPROCAL
    mixtures = {k: expectation_maximisation(com_m[:n], k, seed=seed)[0] for k in SIZES}
    bandwidth_m = max(CANDIDATES_M, key=lambda h: float(KernelDensity(com_m[:n], h).log_density(com_m[n:]).mean()))
    return FootDensity(KernelDensity(com_m, bandwidth_m), com_m[n:], mixtures)


def sufficient_claim(
    key: str, says: str, sizes: SizeDivergences, size: int, *, is_of_thesis: bool, where: str = ""
) -> Claim:
    """The claim that ``size`` components are enough, since the divergence stagnates from there; else an aim of ours."""
    share, at = sizes.excess_share(size), sizes.of_size
    numbers = (
        Measured(key, "stagnates", share, "1", at_most(SUFFICIENT_SHARE, "ours"))
        if is_of_thesis
        else target(key, share, "1", at_most=SUFFICIENT_SHARE)
    )
    return numbers.says(
        says,
        f"Part of the fall of the divergence from one component, {at[1].kl_nats:.3f} nats, to its minimum at "
        f"{sizes.least}, {at[sizes.least].kl_nats:.4f} nats, that is left at {size}.",
        interval=sizes.excess_interval(size),
        where=where,
    )


def reproduce_foot_density(
    robot: str, title: str, sizes: Sequence[int], size: int, seed: int, tell: Progress
) -> Reproduction:
    """Reproduce the figure for one robot with mixtures of ``sizes``, of which ``size`` is the one that it shows."""
    tell(0.1, f"fitting {title}")
    density = effector_density(robot, EFFECTOR, seed)
    divergences = density.compute_divergences(seed)
    density = replace(density, mixtures={k: density.mixtures[k] for k in sizes})
    grid = grid_around(density.kernels)
    x, y, z = (project_kernels(density.kernels, grid, along) for along in range(3))
    rows = [Row("kernels", (x, y, z))]
    for k, mixture in density.mixtures.items():
        px, py, pz = (project_mixture(mixture, grid, along) for along in range(3))
        rows.append(Row(f"{k} components", (px, py, pz)))
    tell(0.6, "comparing level sets")
    sets = level_set_table(density, seed)
    claims = _density_claims(title, density, size, hull_area_share(y, 0.5), sets, divergences)
    return Reproduction(
        claims=claims,
        note=f"{title}, right foot, postures uniform in the joints: 5000 bundled samples with bandwidth "
        f"{density.kernels.bandwidth_m:g} m, by held-out likelihood. The thesis does not state its bandwidth.",
        tables={"level_sets": sets, "divergence": divergences.make_columns(sorted({1, *sizes, divergences.least}))},
        drawing=svg_maps(rows, grid),
        references=REFERENCES,
    )


def level_set_table(density: FootDensity, seed: int = 0) -> dict[str, Float[np.ndarray, "_"]]:
    """Level sets of the mixtures compared with those of the kernel density and with held-out samples."""
    rng = np.random.default_rng(seed)
    x = density.kernels.sample(DRAWS, rng)
    log_p = density.kernels.log_density(x)
    rows = []
    for k, mixture in density.mixtures.items():
        own = mixture.log_density(mixture.sample(DRAWS, rng))
        log_q, unseen = mixture.log_density(x), mixture.log_density(density.held_out)
        for mass in MASSES:
            p, q = np.quantile(log_p, 1.0 - mass), np.quantile(own, 1.0 - mass)
            volumes = [np.exp(-values[values >= t]).sum() / DRAWS for values, t in ((log_p, p), (own, q))]
            rows.append((k, mass, (log_q >= q).mean(), (unseen >= q).mean(), volumes[1] / volumes[0]))
    names = ("components", "mass", "kernel_mass_inside", "unseen_samples_inside", "volume_over_kernels")
    return {name: np.array(column, dtype=float) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def _density_claims(
    title: str,
    density: FootDensity,
    k: int,
    filled: float,
    sets: Mapping[str, Float[np.ndarray, "_"]],
    divergences: SizeDivergences,
) -> tuple[Claim, ...]:
    one, least = (divergences.of_size[size] for size in (1, divergences.least))
    at = (sets["components"] == k) & (sets["mass"] == MASSES[-1])
    unseen, inside, volume = (
        float(sets[name][at][0]) for name in ("unseen_samples_inside", "kernel_mass_inside", "volume_over_kernels")
    )
    held_out = density.held_out
    log_q, log_p = (of.log_density(held_out) for of in (density.mixtures[k], density.kernels))

    def peak_ratio(chosen: Sequence[int]) -> float:
        return float(np.exp(log_q[chosen].max() - log_p[chosen].max()))

    n = len(held_out)
    errors = (STANDARD_ERRORS_95 * one.kl_sd_nats, STANDARD_ERRORS_95 * least.kl_sd_nats)
    return (
        Measured(
            "sagittal_area_over_hull",
            "not convex",
            filled,
            "1",
            below(CONVEX_AREA_SHARE, "ours"),
        ).says(
            "the density is not convex: banana-shaped in the x-z plane",
            "Area with half of the projected mass over the area of its convex hull.",
            no_interval="one_sample",
        ),
        Measured(
            "one_normal_over_best",
            "cannot",
            one.kl_nats / least.kl_nats,
            "1",
            above(2.0, "ours"),
        ).says(
            "a single normal distribution cannot approximate it",
            f"KL of one component over the minimum of 1 to 20 components, which is at {divergences.least}. Interval: "
            "both at the ends of their own, by the standard errors of the draws.",
            interval=(
                (one.kl_nats - errors[0]) / (least.kl_nats + errors[1]),
                (one.kl_nats + errors[0]) / (least.kl_nats - errors[1]),
            ),
        ),
        sufficient_claim(
            "excess_share",
            f"{k} components are enough for a foot of {title}",
            divergences,
            k,
            is_of_thesis=title == "HRP-2",
            where="figure 4.3" if title == "HRP-2" else "",
        ),
        Measured(
            "peak_off",
            "not perfectly",
            abs(peak_ratio(range(n)) - 1.0),
            "1",
            above(0.05, "ours"),
        ).says(
            "the mixture does not fit the maximal values perfectly",
            f"Highest density at held-out samples with {k} components over that of the kernels, "
            f"{peak_ratio(range(n)):.2f}, "
            "minus one; the kernels flatten features narrower than their bandwidth.",
            interval=resampled_interval(lambda chosen: abs(peak_ratio(chosen) - 1.0), n),
        ),
        Measured("unseen_samples_inside", "≥ 0.95", unseen, "1", at_least(MASSES[-1], "words")).says(
            "the mixture is conservative with respect to the support",
            f"Share of {n} held-out samples inside the 95 % set of the mixture with {k} components.",
            n=n,
            interval=share_interval(round(unseen * n), n),
        ),
        Measured("kernel_mass_inside", "≥ 0.95", inside, "1", at_least(MASSES[-1] - SAMPLING_ERROR, "words")).says(
            "the mixture is conservative with respect to the level sets of the kernel density",
            f"Mass of the kernel density inside the same set, whose volume is {volume:.2f} of the kernels' own set: "
            "the kernels widen the distribution of the samples, to which EM is fitted directly. Met within two "
            "standard errors of the draws.",
            n=DRAWS,
            no_interval="in_claim",
        ),
    )
