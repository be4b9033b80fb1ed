"""Hold the proxy of section 4.3 against inverse kinematics, and learn its correction.

    make_proxy_validation.py talos hrp2        all parts: some 8 minutes of one core for TALOS, 12 for HRP-2
    make_proxy_validation.py talos --parts learn   only the correction, models/feasibility/talos.json
    make_proxy_validation.py --tables          only the tables in Markdown, of what is kept

Parts: pairs (random contact sets with their truth), learn, areas (ROC), stances (volumes, figure 4.5). What was
computed is kept in .data/proxy-validation and not computed again unless --anew is given. Seeds are fixed.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from experiments import proxy_roc
from experiments.feasibility_learning import learn_feasibility, save_feasibility
from experiments.random_contacts import LabelledPairs, balance_labels, random_pairs
from stridelab.reachability.kinematics.ik_ground_truth import ANY_POSTURE, STANDING_POSTURE, ContactBatch, StanceTruth
from stridelab.reachability.kinematics.whole_body_ik import Target
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.proxy.feasibility_correction import (
    FeasibilityCard,
    read_feasibility,
)
from stridelab.reachability.store import load_proxies
from stridelab.reproduction.studies import proxy_accuracy
from stridelab.robots.loader import load_robot

ROOT = Path(__file__).parents[1]
CACHE, MODELS = ROOT / ".data" / "proxy-validation", ROOT / "models" / "feasibility"
PARTS = ("pairs", "learn", "areas", "stances")
RANGES = {"standing": STANDING_POSTURE, "any": ANY_POSTURE}
CONTACTS = {"two feet": False, "two feet and a hand": True}
TESTED = {"stances": 100, "per_stance": 34, "walkers": 8, "rounds": 20}
TAUGHT = {"stances": 250, "per_stance": 16, "walkers": 2, "rounds": 10}
TEST_SEED, TEACH_SEED = 7, 101
PAIRS, LEAST = 2000, 0.3
DEGREES = (2, 3, 4)


def main() -> None:
    """Read the command line, compute, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", choices=["talos", "hrp2", []])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--only", help="only pairs whose name holds this")
    parser.add_argument("--anew", action="store_true")
    parser.add_argument("--tables", action="store_true")
    arguments = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    for name in arguments.robots:
        for part in PARTS:
            if part in arguments.parts:
                {"pairs": make_pairs, "learn": learn, "areas": areas, "stances": stances}[part](
                    name, anew=arguments.anew, only=arguments.only or ""
                )
    if arguments.tables:
        sys.stdout.write("\n".join(tables()) + "\n")


def make_pairs(name: str, *, anew: bool, only: str) -> None:
    """Random pairs with their truth: to test in both ranges, and to teach in the standing one."""
    for within in RANGES:
        for contacts, hand in CONTACTS.items():
            for purpose in ("test", "teach") if within == "standing" else ("test",):
                path = pairs_path(name, contacts, within, purpose)
                if (path.is_file() and not anew) or only not in path.stem:
                    continue
                start = time.process_time()
                counts, seed = (TESTED, TEST_SEED) if purpose == "test" else (TAUGHT, TEACH_SEED)
                truth = StanceTruth(load_robot(name), RANGES[within])
                pairs = random_pairs(truth, **counts, seed=seed, hand=hand)
                save(path, pairs)
                sys.stderr.write(f"{path.stem}: {time.process_time() - start:.0f} s, {pairs.shares[[-2, -1]]}\n")


def learn(name: str, *, anew: bool, only: str) -> None:
    """The correction."""
    path = MODELS / f"{name}.json"
    if path.is_file() and not anew:
        return
    taught = [load(pairs_path(name, contacts, "standing", "teach")) for contacts in CONTACTS]
    effectors = learn_feasibility(taught[0], taught[1], TEACH_SEED)
    card = FeasibilityCard(
        robot=name,
        robot_sha256=load_robot(name).sha256,
        seed=TEACH_SEED,
        stances=sum(len(np.unique(pairs.stance)) for pairs in taught),
        pairs=int(sum(pairs.feasible.sum() for pairs in taught)),
        effectors=effectors,
    )
    save_feasibility(path, card)


def areas(name: str, *, anew: bool, only: str) -> None:
    """Areas under the ROC curve for every kind of contacts and range."""
    measured = []
    for within in RANGES:
        for contacts in CONTACTS:
            path = pairs_path(name, contacts, within, "test")
            if not path.is_file():
                continue
            drawn = load(path)
            pairs = balance_labels(drawn, PAIRS, LEAST, np.random.default_rng(0))
            rows = [asdict(row) for row in proxy_roc.roc_areas(name, pairs, corrected(name))]
            rows += [polynomial(name, contacts, pairs, degree) for degree in DEGREES]
            outside = ((drawn.com_m < drawn.low_m) | (drawn.com_m > drawn.high_m)).any(axis=1)
            head = {
                "contacts": contacts,
                "truth": within,
                "sets": len(np.unique(drawn.stance)),
                "drawn": len(drawn.com_m),
                "feasible_share_drawn": float(drawn.feasible.mean()),
                "feasible_share": float(pairs.feasible.mean()),
                "risen_in_last_5_rounds": float(drawn.shares[-1] - drawn.shares[-6]),
                "feasible_outside_box": int((outside & drawn.feasible).sum()),
            }
            measured.append(head | {"areas": rows})
    write(f"areas-{name}", measured)


def polynomial(name: str, contacts: str, pairs: LabelledPairs, degree: int) -> dict[str, object]:
    """The other correction that was tried: logistic regression on a polynomial, taught on other contact sets."""
    taught = load(pairs_path(name, contacts, "standing", "teach"))
    model = make_pipeline(StandardScaler(), PolynomialFeatures(degree), LogisticRegression(C=0.1, max_iter=1000))
    model.fit(proxy_roc.regression_features(taught), taught.feasible)
    score = model.decision_function(proxy_roc.regression_features(pairs))
    row = proxy_roc.Area(
        f"logistic, degree {degree}", proxy_roc.roc_area(pairs.feasible, score), proxy_roc.roc_area_sd(pairs, score)
    )
    return asdict(row)


def stances(name: str, *, anew: bool, only: str) -> None:
    """Sets of the product against those of the truth."""
    search = StanceTruth(load_robot(name), ANY_POSTURE)
    densities = {
        "uniform": load_proxies(name, "uniform"),
        "conditioned": load_proxies(name, "conditioned"),
        "corrected": corrected(name),
    }
    rows = []
    for label, placements in (proxy_accuracy.four_stances(name) | proxy_accuracy.stair_contacts(name)).items():
        truth = proxy_accuracy.Truth.of(search, placements)
        rows += [asdict(row) for row in proxy_accuracy.compare_densities(search, label, placements, truth, densities)]
    write(f"stances-{name}", rows)


def corrected(name: str) -> Mapping[str, Proxy]:
    """The correction as it lies in models/."""
    effectors = read_feasibility(MODELS / f"{name}.json").effectors
    return {effector: flat.to_proxy() for effector, flat in effectors.items()}


def pairs_path(name: str, contacts: str, within: str, purpose: str) -> Path:
    """Path of the cached pairs."""
    return CACHE / f"pairs-{name}-{contacts.replace(' ', '-')}-{within}-{purpose}.npz"


def save(path: Path, pairs: LabelledPairs) -> None:
    """Plain arrays."""
    places = {f"p_{name}": p for name, (p, _) in pairs.contacts.targets.items()}
    turns = {f"R_{name}": R for name, (_, R) in pairs.contacts.targets.items() if R is not None}
    np.savez_compressed(
        path,
        allow_pickle=False,
        heading_rad=pairs.contacts.heading_rad,
        com_m=pairs.com_m,
        feasible=pairs.feasible,
        stance=pairs.stance,
        low_m=pairs.low_m,
        high_m=pairs.high_m,
        shares=pairs.shares,
        **places,
        **turns,
    )


def load(path: Path) -> LabelledPairs:
    """Load the arrays that ``save`` wrote."""
    with np.load(path, allow_pickle=False) as archive:
        names = [key[2:] for key in archive.files if key.startswith("p_")]
        targets = {
            n: Target(archive[f"p_{n}"], archive[f"R_{n}"] if f"R_{n}" in archive.files else None) for n in names
        }
        parts = [archive[key] for key in ("com_m", "feasible", "stance", "low_m", "high_m", "shares")]
        return LabelledPairs(ContactBatch(targets, archive["heading_rad"]), *parts)


def write(stem: str, figures: object) -> None:
    """Keep numbers as text."""
    (CACHE / f"{stem}.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def tables() -> list[str]:
    """All tables in Markdown."""
    lines: list[str] = []
    for path in sorted(CACHE.glob("areas-*.json")):
        cases = json.loads(path.read_text(encoding="utf-8"))
        heads = [f"{case['contacts']}, {case['truth']}" for case in cases]
        lines += [f"**{path.stem}**", "", f"| score | {' | '.join(heads)} |", "|---" * (1 + len(cases)) + "|"]
        for k, row in enumerate(cases[0]["areas"]):
            cells = [f"{case['areas'][k]['area']:.3f} ± {case['areas'][k]['area_sd']:.3f}" for case in cases]
            lines.append(f"| {row['score']} | {' | '.join(cells)} |")
        for key in [key for key in cases[0] if key not in ("areas", "contacts", "truth")]:
            lines.append(f"| {key.replace('_', ' ')} | {' | '.join(f'{case[key]:.3g}' for case in cases)} |")
        lines.append("")
    for path in sorted(CACHE.glob("stances-*.json")):
        lines += [
            f"**{path.stem}**",
            "",
            "| contacts | densities | truth 50/80/95 % (l) | product | mass in | truth in | false | at mode | z (m) |",
            "|---|---|---|---|---|---|---|---|---|",
        ]
        for row in json.loads(path.read_text(encoding="utf-8")):
            volumes = ["/".join(f"{1e3 * v:.0f}" for v in row[f"{key}_volumes_m3"]) for key in ("truth", "product")]
            numbers = [row[key] for key in ("mass_inside", "truth_inside", "false_feasible", "density_at_mode")]
            cells = [
                row["contacts"],
                row["densities"],
                *volumes,
                *(f"{n:.2f}" for n in numbers),
                f"{row['mode_m'][2]:.2f}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return lines


if __name__ == "__main__":
    main()
