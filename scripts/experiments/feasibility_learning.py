"""Learns ``reachability.proxy.feasibility_correction`` from labelled pairs."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import TypeAdapter

from experiments.random_contacts import HAND, SOLES, LabelledPairs
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.fit import expectation_maximisation
from stridelab.reachability.proxy.effector_proxy import Frame
from stridelab.reachability.proxy.feasibility_correction import FeasibilityCard, FlatDensity, com_in_frame

COMPONENTS: Final = 14


def learn_feasibility(sole_pairs: LabelledPairs, hand_pairs: LabelledPairs, seed: int) -> dict[str, FlatDensity]:
    """Learn the densities of all effectors by EM; that of the left hand mirrors that of the right hand."""
    of_soles = {name: _fit_feasible(sole_pairs, name, "contact", seed) for name in SOLES}
    right = _fit_feasible(hand_pairs, HAND, "heading", seed)
    mirror = np.array([1.0, -1.0, 1.0])
    left = Mixture(right.weights, right.means_m * mirror, right.covariances_m2 * np.outer(mirror, mirror))
    sole_densities = {name: _to_flat_density(mixture, "contact") for name, mixture in of_soles.items()}
    return sole_densities | {"left_hand": _to_flat_density(left, "heading"), HAND: _to_flat_density(right, "heading")}


def save_feasibility(path: Path, card: FeasibilityCard) -> None:
    """Write a card; ``read_feasibility`` reads the same one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(card), allow_nan=False) + "\n", encoding="utf-8")


def _fit_feasible(pairs: LabelledPairs, name: str, frame: Frame, seed: int) -> Mixture:
    feasible = np.flatnonzero(pairs.feasible)
    feasible_pairs = pairs.select(feasible)
    return expectation_maximisation(
        com_in_frame(frame, feasible_pairs.contacts, name, feasible_pairs.com_m), COMPONENTS, seed
    )[0]


def _to_flat_density(mixture: Mixture, frame: Frame) -> FlatDensity:
    parts = (mixture.weights, mixture.means_m, mixture.covariances_m2)
    fields = {name: part.tolist() for name, part in zip(("weights", "means", "covariances"), parts, strict=True)}
    return TypeAdapter(FlatDensity).validate_python({"frame": frame, **fields})
