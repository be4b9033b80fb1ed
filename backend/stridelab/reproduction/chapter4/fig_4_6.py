"""Figure 4.6: outer Lorentz cone shrunk by alpha, its stated properties, and the largest inner Lorentz cone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone
from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, at_least, at_most, reproduces, target
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.cone_validation import (
    FINE_RAYS,
    ROUNDING,
    ConeCheck,
    Timed,
    check_cones,
    check_summary,
    thesis_cone,
    timed_cone,
)
from stridelab.reproduction.studies.random_contact_sets import stair_sets

ROBOT: Final = "hrp2"
SETS: Final = 240
POINTS: Final = 6
MAX_CHANGE: Final = 1e-6
ALPHA_TOLERANCE: Final = 0.005
"""An alpha that rounds to 0.30 is the printed one."""
CIRCLE_RAYS: Final = 32
"""Rays per contact point that approximate the circular cone."""


@dataclass(frozen=True)
class Row:
    """Results on one contact set; ``kept_*`` are volumes relative to that of the pyramids with four rays."""

    contacts: str
    alpha_max: float
    kept_02: float
    kept_03: float
    kept_alpha_max: float
    kept_ours: float
    excess_of_true: float
    true_rays_outside: float
    thesis: Timed
    ours: Timed


@reproduces("fig-4.6", "Lorentz cones around and inside the cone of wrenches", draws="one", printed=("sets",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """One random sample of contact sets."""
    rows = []
    for name, contacts in stair_sets(ROBOT).items():
        tell(0.1, name)
        rows.append(compare_cones(name, contacts))
    tell(0.3, f"{SETS} random contact sets")
    checks = check_cones(SETS, POINTS, seeds[0])
    return Reproduction(
        claims=figure_claims(rows, checks),
        note=f"The stances of figure 4.5 (HRP-2, friction 0.5), the thesis' cone about a CoM 0.8 m above the mean of "
        f"the contacts, in N and N m; alpha_max in circular cones of {FINE_RAYS} rays, volumes relative to pyramids of "
        f"four rays; {SETS} random sets of 2 to 4 tilted bodies within 3 m.{undefined_note(checks)}",
        tables={"sets": cone_table(rows)},
        drawing=render_svg(
            Bars("alpha up to which the cone is inside", "1", [(row.contacts, row.alpha_max) for row in rows]),
            Bars(
                "volume kept",
                "1",
                [
                    (f"{row.contacts}, {what}", value)
                    for row in rows
                    for what, value in (("alpha 0.3", row.kept_03), ("largest", row.kept_ours))
                ],
            ),
        ),
    )


def undefined_note(checks: list[ConeCheck]) -> str:
    """How many random sets the thesis' claims leave out, as a sentence that follows another one; empty for none."""
    undefined = check_summary(checks)["thesis_undefined"]
    if not undefined:
        return ""
    return f" {undefined} of them have no cone of the thesis and are left out of the claims on it."


def compare_cones(name: str, contacts: PointContacts) -> Row:
    """Compare the thesis' cone and the largest inner cone on one contact set."""
    pyramids, fine = (LinearCone.from_contacts(contacts, rays) for rays in (4, FINE_RAYS))
    thesis, thesis_time = timed_cone(lambda: thesis_cone(contacts))
    ours, our_time = timed_cone(lambda: LinearCone.from_contacts(contacts).largest_lorentz())
    alpha = fine.alpha_max(thesis)
    gauges = thesis.gauge(contacts.wrench_rays(CIRCLE_RAYS))
    return Row(
        name,
        alpha,
        pyramids.volume_ratio(thesis.shrink(0.2)),
        pyramids.volume_ratio(thesis.shrink(0.3)),
        pyramids.volume_ratio(thesis.shrink(alpha)),
        pyramids.volume_ratio(ours),
        float(gauges.max()) - 1.0,
        float((gauges > 1.0).mean()),
        thesis_time,
        our_time,
    )


def figure_claims(rows: list[Row], checks: list[ConeCheck]) -> tuple[Claim, ...]:
    """Claims of section 4.4 on the cones: ``rows`` of the stances of figure 4.5, ``checks`` of random sets."""
    random = check_summary(checks)
    alphas = np.array([check.alpha_max for check in checks if np.isfinite(check.alpha_max)])
    kept = [c.volume_ratio / c.thesis_volume_ratio for c in checks if np.isfinite(c.alpha_max)]
    sound = sum(check.violation <= 0.0 and check.least_margin >= -ROUNDING for check in checks)
    excess = max(row.excess_of_true for row in rows)
    fifth, third = random["share_where_0.2_leaves"], random["share_where_0.3_leaves"]
    on_stairs = min(row.alpha_max for row in rows)
    return (
        Measured("excess_of_true", 0.0, excess, "1", at_most(0.0, "words", otherwise="thesis_in_error")).says(
            "the outer approximation (alpha = 1) contains the true cone, in all six dimensions",
            "Largest gauge of a ray of the circular cones, minus 1: the four rays per contact from which it is built "
            "are inside, the circular cones between them are not. In the plane section of figure 4.7 it contains them.",
            n=len(rows),
            no_interval="deterministic",
        ),
        Measured("alpha_fifth", 0.0, fifth, "1", at_most(0.0, "words", otherwise="thesis_in_error")).says(
            "with alpha = 1/5 it is guaranteed to lie inside",
            f"Share of random sets where it is not inside; the largest alpha inside is {random['least_alpha_max']:.3f} "
            f"(minimum) and {random['median_alpha_max']:.3f} (median). John's theorem applies to the ellipsoid of step "
            "(ii), whereas step (iv) fixes the centre.",
            n=len(alphas),
            cases_inside=int((alphas >= 0.2).sum()),
        ),
        Measured("alpha_third_stairs", 0.3, on_stairs, "1", at_least(0.3 - ALPHA_TOLERANCE, "thesis")).says(
            "alpha = 0.3 is inside (figure 4.7; two, three and four contacts on the stair)",
            f"Smallest alpha_max of the sets, {', '.join(f'{row.alpha_max:.3f}' for row in rows)}, which are only "
            f"approximately those of the thesis; circular cones by {FINE_RAYS} rays. Met to two digits.",
            n=len(rows),
            no_interval="deterministic",
        ),
        Measured("alpha_third", 0.0, third, "1", at_most(0.0, "words")).says(
            "the same on random sets",
            f"Share of random sets where the cone with alpha = 0.3 leaves the circular cones ({FINE_RAYS} rays).",
            n=len(alphas),
            cases_inside=int((alphas >= 0.3).sum()),
        ),
        target("violations", float(random["facets_violated"] + random["points_outside"]), "1", at_most=0.0).says(
            "largest inner cone: violated facets and boundary points",
            n=len(checks),
            cases_inside=sound,
        ),
        target("kept", random["median_kept_over_thesis"], "1", at_least=2.5).says(
            "its volume over that with alpha = 0.3, median of random sets",
            n=len(kept),
            interval=interval_of(kept, np.median),
        ),
        target("change", random["largest_change"], "1", at_most=MAX_CHANGE).says(
            "its change with the reference point and unit of length",
            n=len(checks),
            cases_inside=sum(check.change <= MAX_CHANGE for check in checks),
        ),
    )


def cone_table(rows: list[Row]) -> Mapping[str, Column]:
    """One row per contact set."""
    names = (
        "contacts",
        "alpha_max",
        "kept_02",
        "kept_03",
        "kept_alpha_max",
        "kept_ours",
        "excess_of_true",
        "true_rays_outside",
    )
    columns: dict[str, Column] = {name: np.array([getattr(row, name) for row in rows]) for name in names}
    return columns | {
        "thesis_ms": np.array([1e3 * row.thesis.time_s for row in rows]),
        "ours_ms": np.array([1e3 * row.ours.time_s for row in rows]),
    }
