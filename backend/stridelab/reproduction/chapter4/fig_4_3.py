"""Figure 4.3: KL divergence of the mixture from the kernel density versus its size, for the four effectors.

The densities are those of figures 4.2 and 4.4 (``foot_density``): 5000 bundled samples, one rule for the bandwidth.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reachability.card import EffectorCard
from stridelab.reachability.learning.fit import THESIS_COMPONENTS
from stridelab.reachability.store import load_card
from stridelab.reproduction.chapter4.foot_density import (
    REFERENCES,
    SIZES,
    STANDARD_ERRORS_95,
    SizeDivergences,
    effector_density,
    sufficient_claim,
)
from stridelab.reproduction.claims import Claim, Measured, Reproduction, above, reproduces
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg

ROBOTS: Final = {"hrp2": "HRP-2", "talos": "TALOS"}
LARGEST_SIZE: Final = SIZES[-1]
NOTE: Final = (
    "5000 bundled samples of each effector, EM on four fifths of them; the kernels' bandwidth is that under which the "
    "last fifth is most likely, as in figures 4.2, 4.4 and 4.5; 10 000 draws for all sizes. The densities of the "
    "planner are learned from 20 000 samples. The thesis uses a dichotomic search, which the fluctuations of a sampled "
    "curve would mislead. Figure 4.3 is of HRP-2: what it says is an aim of ours for TALOS."
)


@reproduces("fig-4.3", "Divergence of the mixture over its size", draws="one", printed=("sizes",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Mixtures of 1 to 20 components of the four effectors of both robots."""
    seed, found = seeds[0], []
    effectors = [(robot, *item) for robot in ROBOTS for item in load_card(robot, "uniform").effectors.items()]
    for number, (robot, name, card) in enumerate(effectors):
        tell(number / len(effectors), f"fitting {ROBOTS[robot]}, {name}")
        density = effector_density(robot, name, seed)
        found.append(_EffectorSizes(robot, name, card, density.kernels.bandwidth_m, density.compute_divergences(seed)))
    return Reproduction(
        claims=tuple(claim for each in found for claim in each.make_claims()),
        note=NOTE,
        tables={
            "sizes": {
                "robot": np.array([each.robot for each in found]),
                "effector": np.array([each.name for each in found]),
                "bandwidth_m": np.array([each.bandwidth_m for each in found]),
                "thesis": np.array([each.thesis_size for each in found]),
                "least": np.array([each.sizes.least for each in found]),
                "kl_one_nats": np.array([each.kl_nats(1) for each in found]),
                "kl_thesis_nats": np.array([each.kl_nats(each.thesis_size) for each in found]),
                "kl_least_nats": np.array([each.kl_nats(each.sizes.least) for each in found]),
                "excess_share": np.array([each.sizes.excess_share(each.thesis_size) for each in found]),
            },
            "curves": {
                "robot": np.array([each.robot for each in found for _ in SIZES]),
                "effector": np.array([each.name for each in found for _ in SIZES]),
                **{
                    name: np.concatenate([each.sizes.make_columns(SIZES)[name] for each in found])
                    for name in found[0].sizes.make_columns(SIZES)
                },
            },
        },
        drawing=render_svg(*(_robot_panel(ROBOTS[robot], [e for e in found if e.robot == robot]) for robot in ROBOTS)),
        references=REFERENCES,
    )


@dataclass(frozen=True)
class _EffectorSizes:
    """Divergences of one effector by the number of components."""

    robot: str
    name: str
    card: EffectorCard
    bandwidth_m: float
    sizes: SizeDivergences

    @property
    def thesis_size(self) -> int:
        return THESIS_COMPONENTS["surface" if self.name.endswith("foot") else "point"]

    @property
    def card_rise_nats(self) -> float:
        """Divergence of the bundled card at the largest size above that of the thesis' size."""
        kl_nats = {trial.components: trial.kl_nats for trial in self.card.sizes}
        return kl_nats[LARGEST_SIZE] - kl_nats[self.thesis_size]

    def kl_nats(self, size: int) -> float:
        return self.sizes.of_size[size].kl_nats

    def make_claims(self) -> list[Claim]:
        """Claims that the divergence stagnates at the thesis' size and rises beyond it for the hands of HRP-2."""
        size, is_of_thesis = self.thesis_size, self.robot == "hrp2"
        who, key = f"{ROBOTS[self.robot]}, {self.name.replace('_', ' ')}", f"{self.robot}_{self.name}"
        says = f"{who}: {size} components are sufficient"
        claims = [sufficient_claim(f"{key}_excess_share", says, self.sizes, size, is_of_thesis=is_of_thesis)]
        if is_of_thesis and size == THESIS_COMPONENTS["point"]:
            rise = self.kl_nats(LARGEST_SIZE) - self.kl_nats(size)
            errors_nats = [self.sizes.of_size[k].excess_sd_nats for k in (size, LARGEST_SIZE)]
            half = STANDARD_ERRORS_95 * math.hypot(*errors_nats)
            ends = (rise - half, rise + half, self.card_rise_nats)
            claims.append(
                Measured(f"{key}_rise_nats", "rises", rise, "nats", above(0.0, "words")).says(
                    f"{who}: the divergence rises beyond {size}",
                    f"KL of {LARGEST_SIZE} components above that of {size}. With Scott's bandwidth and 20 000 samples "
                    f"(the bundled card) it is {self.card_rise_nats:+.4f} nats; the thesis states no bandwidth. "
                    "Interval: the standard errors of both differences from the smallest divergence, and the other "
                    "bandwidth.",
                    interval=(min(ends), max(ends)),
                )
            )
        return claims


def _robot_panel(title: str, found: Sequence[_EffectorSizes]) -> Panel:
    curves = []
    for colour, each in enumerate(found):
        kl = np.array([each.kl_nats(size) for size in SIZES])
        label = f"{each.name.replace('_', ' ')}: least at {each.sizes.least}"
        curves.append(Curve(np.array(SIZES, dtype=float), kl, label, colour))
    top = max(c.y.max() for c in curves)
    curves += [
        Curve(np.array([float(size)] * 2), np.array([0.0, top]), f"thesis: {size}", 6, dashed=True)
        for size in sorted({each.thesis_size for each in found})
    ]
    return Panel(f"{title}: divergence over size", "components (1)", "KL (nats)", curves)
