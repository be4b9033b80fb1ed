"""Figure 4.5: CoM on two, three and four contacts: ground truth by inverse kinematics and product of densities (4.12).

The ground truth has the postures of the densities: a free trunk for the uniform densities, standing postures for the
conditioned ones. Its bandwidth is chosen by held-out likelihood, and its level sets are calibrated on held-out
postures. One block of maps per set and densities: ground truth and product. Solid lines enclose 95 % of the projected
ground truth, dashed lines 95 % of the product.
"""

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.card import Measure
from stridelab.reachability.kinematics.ik_ground_truth import (
    FREE_TRUNK,
    STANDING_POSTURE,
    ContactBatch,
    PostureRange,
    StanceTruth,
)
from stridelab.reachability.learning.kde import KernelDensity, held_out_bandwidth_m
from stridelab.reachability.proxy.contact_set_proxy import ContactSet
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.proxy.projections import grid_around, project_kernels, project_mixture
from stridelab.reachability.store import load_proxies
from stridelab.reproduction.claims import (
    Claim,
    Column,
    Measured,
    Reproduction,
    above,
    at_most,
    below,
    reproduces,
    target,
)
from stridelab.reproduction.report.svg_density_maps import WIDTH, Row, svg_maps
from stridelab.reproduction.studies.proxy_accuracy import MASSES, Comparison, Truth, compare_densities, stair_contacts
from stridelab.robots.loader import load_robot

ROBOT: Final = "hrp2"
POSTURES: Final[Mapping[Measure, PostureRange]] = {"uniform": FREE_TRUNK, "conditioned": STANDING_POSTURE}
"""Postures of the ground truth with which a choice of densities is compared."""
DRAWS: Final = 400
PROBES: Final = 60
REGION_MASS: Final = 0.5
"""Share of the ground truth in its region of highest probability, the smallest one with this share."""
_VIEW_HEIGHT: Final = re.compile(r'viewBox="0 0 \d+ (\d+)"')


@reproduces("fig-4.5", "The CoM on two, three and four contacts", draws="one", printed=("sets",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """One random sample of postures."""
    sets = stair_contacts(ROBOT)
    rows: list[Comparison] = []
    blocks: list[str] = []
    bandwidths_m: dict[str, float] = {}
    for number, (measure, within) in enumerate(POSTURES.items()):
        search = StanceTruth(load_robot(ROBOT), within)
        densities: dict[str, Mapping[str, Proxy]] = {measure: load_proxies(ROBOT, measure)}
        postures = {}
        for k, (name, placements) in enumerate(sets.items()):
            tell((number + 0.25 * k) / len(POSTURES), f"{name}, postures for the {measure} densities")
            postures[name] = search.sample_com(placements, 2 * DRAWS, seeds[0])
        bandwidths_m[measure] = held_out_bandwidth_m([com_m[:DRAWS] for com_m in postures.values()])
        for name, placements in sets.items():
            truth = Truth.from_postures(postures[name], bandwidths_m[measure])
            rows += compare_densities(search, name, placements, truth, densities, PROBES, len(sets))
            blocks.append(_contact_set_maps(name, search, placements, truth, densities))
    rows.sort(key=lambda row: row.contacts)
    widths = " and ".join(f"{width_m:g} m ({measure})" for measure, width_m in bandwidths_m.items())
    return Reproduction(
        claims=figure_claims(rows),
        note=f"HRP-2 on a stair of 0.30 m by 0.15 m, then with one hand and with both hands on rails; {DRAWS} postures "
        "of the ground truth for its kernels and the same number for its thresholds; base and free joints uniform, "
        "limbs by inverse kinematics. Truth and densities draw the trunk alike: free for the uniform densities, "
        f"standing for the conditioned ones. Bandwidths by held-out likelihood: {widths}. Level sets of the truth "
        "contain their share of held-out postures.",
        tables={"sets": comparison_table(rows)},
        drawing=stack_svgs(blocks),
        references=("carpentier2017thesis", "carpentier2018multicontact"),
        n=len(sets),
    )


def figure_claims(rows: list[Comparison]) -> tuple[Claim, ...]:
    """Claims of section 4.3.3.2 on the figure."""
    uniform, conditioned = ([row for row in rows if row.densities == name] for name in ("uniform", "conditioned"))
    truths, products = (
        np.array([getattr(row, f"{kind}_volumes_m3")[-1] for row in uniform]) for kind in ("truth", "product")
    )
    shrinks = float(max((truths[1:] / truths[:-1]).max(), (products[1:] / products[:-1]).max()))
    covers = float((products / truths).min())
    at_mode, at_ours = (max(row.denser_than_mode for row in some) for some in (uniform, conditioned))
    low, high = np.max([row.denser_interval for row in uniform], axis=0).tolist()
    least = min(row.density_at_mode for row in uniform)
    mass, ours = (min(row.mass_inside for row in some) for some in (uniform, conditioned))
    return (
        Measured("volume_per_contact", "< 1", shrinks, "1", below(1.0, "words", otherwise="thesis_in_error")).says(
            "the volumes of the truth and of the product decrease with the number of contacts",
            "Largest ratio of the 95 % volumes of successive numbers of contacts; uniform densities.",
            no_interval="one_sample",
        ),
        Measured("volume_over_truth", "> 1", covers, "1", above(1.0, "words", otherwise="thesis_in_error")).says(
            "in all cases the product covers a larger region than the truth",
            "Smallest ratio of the 95 % volumes, product of uniform densities over truth. Postures drawn with "
            "replacement repeat, which widens their kernel density: no interval of a volume.",
            no_interval="one_sample",
        ),
        Measured("denser_than_mode", "coincide", at_mode, "1", at_most(REGION_MASS, "ours")).says(
            "the regions of highest probability coincide with the real distributions",
            "Share of the truth's postures that are denser than the truth at the mode of the product of uniform "
            "densities, maximum over all sets: up to 0.5, the mode lies in the smallest region with half of the truth. "
            f"At least {mass:.2f} of the product's mass is inside the 95 % set of the truth, and the truth has at "
            f"least {least:.2f} of its maximum at the mode. By set: "
            f"{', '.join(f'{row.denser_than_mode:.2f}' for row in uniform)}. "
            f"Interval: of the density of {2 * DRAWS} postures at the mode and of their share, for all sets at once.",
            interval=(low, high),
        ),
        target("denser_than_mode_conditioned", at_ours, "1", at_most=REGION_MASS).says(
            "conditioned densities: the same",
            no_interval="one_sample",
        ),
        target("mass_inside_conditioned", ours, "1", at_least=0.9).says(
            "conditioned densities: mass of the product inside the 95 % set of the truth",
            no_interval="one_sample",
        ),
    )


def comparison_table(rows: list[Comparison]) -> Mapping[str, Column]:
    """One row per contact set and choice of densities."""
    columns: dict[str, Column] = {
        name: np.array([getattr(row, name) for row in rows])
        for name in (
            "contacts",
            "densities",
            "mass_inside",
            "truth_inside",
            "false_feasible",
            "density_at_mode",
            "denser_than_mode",
        )
    }
    for kind in ("truth", "product"):
        volumes = np.array([getattr(row, f"{kind}_volumes_m3") for row in rows])
        columns |= {f"{kind}_litres_{100 * m:.0f}_percent": 1e3 * volumes[:, k] for k, m in enumerate(MASSES)}
    return columns


def _contact_set_maps(
    name: str,
    search: StanceTruth,
    placements: Mapping[str, Placement],
    truth: Truth,
    densities: Mapping[str, Mapping[str, Proxy]],
) -> str:
    heading_rad = float(ContactBatch.from_placements(search.robot, [placements]).heading_rad[0])
    products = {
        label: ContactSet.from_placements(proxies, placements, heading_rad) for label, proxies in densities.items()
    }
    reached = [product.sample(DRAWS, np.random.default_rng(0)) for product in products.values()]
    everything = np.concatenate([truth.kernels.centres_m, *reached])
    grid = grid_around(KernelDensity(everything, truth.kernels.bandwidth_m))
    x, y, z = (project_kernels(truth.kernels, grid, along) for along in range(3))
    rows = [Row(name, (x, y, z))]
    for label, product in products.items():
        px, py, pz = (project_mixture(product.product, grid, along) for along in range(3))
        rows.append(Row(label, (px, py, pz)))
    return svg_maps(rows, grid)


def stack_svgs(blocks: list[str]) -> str:
    """Stack SVG documents of the same width vertically."""
    heights = [int(match[1]) for block in blocks if (match := _VIEW_HEIGHT.search(block))]
    size = f'width="{WIDTH}" height="{sum(heights)}"'
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {sum(heights)}" {size} role="img">']
    for number, block in enumerate(blocks):
        parts.append(f'<g transform="translate(0 {sum(heights[:number])})">\n{block}</g>')
    return "\n".join([*parts, "</svg>"]) + "\n"
