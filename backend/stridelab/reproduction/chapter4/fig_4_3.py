"""Figure 4.3: KL divergence of the mixture from the kernel density versus its size, for the four effectors."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reachability.card import EffectorCard, SizeTrial
from stridelab.reachability.store import load_card
from stridelab.reproduction.chapter4.foot_density import REFERENCES, SUFFICIENT_EXCESS_SD
from stridelab.reproduction.claims import Claim, Measured, Reproduction, above, at_most, reproduces
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg

ROBOTS: Final = {"hrp2": "HRP-2", "talos": "TALOS"}
LARGEST_SIZE: Final = 20
NOTE: Final = (
    "The curves are those of the bundled cards (20 000 samples, Scott's bandwidth, 10 000 draws for all sizes), which "
    "learn-reachability recomputes. Our size is the smallest one whose divergence exceeds the minimum over 1 to 20 by "
    "at most the standard error of that difference. The thesis uses a dichotomic search, which the fluctuations of a "
    "sampled curve would mislead."
)


@reproduces("fig-4.3", "Divergence of the mixture over its size", printed=("sizes",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Computed from the bundled cards."""
    tell(0.1, "reading the cards")
    cards = {robot: load_card(robot, "uniform").effectors for robot in ROBOTS}
    effectors = [(robot, name, card) for robot in ROBOTS for name, card in cards[robot].items()]
    trials = [(robot, name, trial) for robot, name, card in effectors for trial in card.sizes]
    return Reproduction(
        claims=tuple(claim for effector in effectors for claim in _effector_claims(*effector)),
        note=NOTE,
        tables={
            "sizes": {
                "robot": np.array([robot for robot, _, _ in effectors]),
                "effector": np.array([name for _, name, _ in effectors]),
                "ours": np.array([card.components for _, _, card in effectors]),
                "thesis": np.array([card.thesis_components for _, _, card in effectors]),
                "least": np.array([_best_trial(card).components for _, _, card in effectors]),
                "kl_ours_nats": np.array([card.kl_nats for _, _, card in effectors]),
                "kl_thesis_nats": np.array(
                    [_kl_of_size_nats(card, card.thesis_components) for _, _, card in effectors]
                ),
                "kl_least_nats": np.array([_best_trial(card).kl_nats for _, _, card in effectors]),
                "kl_sd_nats": np.array([card.kl_sd_nats for _, _, card in effectors]),
            },
            "curves": {
                "robot": np.array([robot for robot, _, _ in trials]),
                "effector": np.array([name for _, name, _ in trials]),
                "components": np.array([t.components for _, _, t in trials]),
                "kl_nats": np.array([t.kl_nats for _, _, t in trials]),
                "kl_sd_nats": np.array([t.kl_sd_nats for _, _, t in trials]),
                "excess_sd_nats": np.array([t.excess_sd_nats for _, _, t in trials]),
                "held_out_log_likelihood": np.array([t.held_out_log_likelihood for _, _, t in trials]),
            },
        },
        drawing=render_svg(*(_robot_panel(ROBOTS[robot], cards[robot]) for robot in ROBOTS)),
        references=REFERENCES,
    )


def _effector_claims(robot: str, name: str, card: EffectorCard) -> list[Claim]:
    """Claims that the divergence stagnates at the thesis' size and rises beyond it for the hands of HRP-2."""
    least, size = _best_trial(card), card.thesis_components
    excess = _kl_of_size_nats(card, size) - least.kl_nats
    who = f"{ROBOTS[robot]}, {name.replace('_', ' ')}"
    claims = [
        Measured(
            f"{robot}_{name}_excess_nats",
            "sufficient",
            excess,
            "nats",
            at_most(SUFFICIENT_EXCESS_SD * least.kl_sd_nats, "words"),
        ).says(
            f"{who}: {size} components are sufficient",
            f"KL above the minimum, which is at {least.components} components; the standard error of the estimate is "
            f"{least.kl_sd_nats:.4f} nats. Our size: {card.components}.",
            no_interval="in_claim",
        )
    ]
    if robot == "hrp2" and name.endswith("hand"):
        rise, sd = (
            _kl_of_size_nats(card, LARGEST_SIZE) - _kl_of_size_nats(card, size),
            card.sizes[LARGEST_SIZE - 1].excess_sd_nats,
        )
        claims.append(
            Measured(f"{robot}_{name}_rise_nats", "rises", rise, "nats", above(sd, "words")).says(
                f"{who}: the divergence rises beyond {size}",
                f"KL of {LARGEST_SIZE} components above that of {size}; the standard error of a difference is "
                f"{sd:.4f} nats.",
                no_interval="in_claim",
            )
        )
    return claims


def _best_trial(card: EffectorCard) -> SizeTrial:
    return min(card.sizes, key=lambda trial: trial.kl_nats)


def _kl_of_size_nats(card: EffectorCard, size: int) -> float:
    return next(trial.kl_nats for trial in card.sizes if trial.components == size)


def _robot_panel(title: str, cards: dict[str, EffectorCard]) -> Panel:
    curves = []
    for colour, (name, card) in enumerate(cards.items()):
        sizes = np.array([t.components for t in card.sizes], dtype=float)
        kl = np.array([t.kl_nats for t in card.sizes])
        curves.append(Curve(sizes, kl, f"{name.replace('_', ' ')}: {card.components}", colour))
    top = max(c.y.max() for c in curves)
    curves += [
        Curve(np.array([float(size)] * 2), np.array([0.0, top]), f"thesis: {size}", 6, dashed=True)
        for size in sorted({card.thesis_components for card in cards.values()})
    ]
    return Panel(f"{title}: divergence over size, and our sizes", "components (1)", "KL (nats)", curves)
