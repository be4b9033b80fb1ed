"""Tables of the theory pages that repeat numbers of docs/reproduction.md: each is written from that page's text.

A function takes the text of the page and returns a table in Markdown; ``BLOCKS`` has them all. Each raises ``KeyError``
if the page lacks a claim, a row or a table that it repeats.
"""

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

INTERVAL: Final = re.compile(r"95 % from (\S+(?: \S+)?) to ([^;|]+)")
WIDTH: Final = 120
"""Of a line of prose."""


@dataclass(frozen=True)
class ClaimRow:
    """A claim as it is printed: its item, its cells, its interval ("" without one) and its remark ("" without one)."""

    item: str
    says: str
    place: str
    thesis: str
    holds: str
    ours: str
    verdict: str
    basis: str
    interval: str
    remark: str


def read_table(page: str, item: str, heads: str) -> list[list[str]]:
    """Cells of the first table of an item whose headings begin with ``heads``, as "gait | case"."""
    for table in _section_of(page, item).split("\n\n"):
        lines = [line for line in table.splitlines() if line.startswith("| ")]
        if lines and lines[0].startswith(f"| {heads} |"):
            return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    raise KeyError(item, heads)


def read_claims(page: str, item: str) -> list[ClaimRow]:
    """All claims of an item."""
    section = _section_of(page, item)
    claims = []
    for cells in read_table(page, item, "claim"):
        says, place, thesis, holds, ours, verdict, basis = cells
        start = f"\n- {says}: "
        remark = section.partition(start)[2].partition("\n")[0] if start in section else ""
        interval = INTERVAL.search(basis)
        text = "" if interval is None else f"{interval[1]} to {interval[2]}"
        claims.append(ClaimRow(item, says, place, thesis, holds, ours, verdict, basis, text, remark))
    return claims


def read_claim(page: str, item: str, words: str) -> ClaimRow:
    """The one claim of an item that contains ``words``; raises ``KeyError`` if none or several do."""
    claims = [of for of in read_claims(page, item) if words in of.says]
    if len(claims) != 1:
        raise KeyError(item, words)
    return claims[0]


def claims_table(page: str, chosen: Iterable[tuple[str, str]], *, remarks: bool = False) -> str:
    """Claims, by item and words, with our numbers and verdicts; ``remarks`` adds those of the book as a list."""
    claims = [read_claim(page, item, words) for item, words in chosen]
    rows = [[of.says, f"`{of.item}`", of.thesis, of.ours, of.verdict, of.basis] for of in claims]
    text = markdown_table(["claim", "item", "thesis", "ours", "", "evidence"], rows)
    notes = [_wrapped(f"- {of.says}: {of.remark}") for of in claims if of.remark] if remarks else []
    return "\n".join([text, *(["", *notes] if notes else [])])


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [f"| {' | '.join(heads)} |".replace("|  |", "| |"), f"|{' --- |' * len(heads)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _wrapped(line: str) -> str:
    return textwrap.fill(line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _section_of(page: str, item: str) -> str:
    return page.partition(f"\n## {item}:")[2].partition("\n## ")[0]


def coverage_block(page: str) -> str:
    """Error, width and coverage of the smoother's band, robot and human cadence, x and y."""
    names = {
        "thesis": "thesis' noise",
        "white": "white noise",
        "table-40": "40 % table, declared",
        "plate-bias": "plate bias of 5 N, 3 Nm, declared",
        "mask": "marker-like, force in 1 s of 2",
        "first-order": "thesis' noise, high-passed once",
    }
    rows = {(row[0], row[1]): row[2:] for row in read_table(page, "coverage", "gait")}
    cells = []
    for key, name in names.items():
        robot, human = rows["robot", key], rows["human", key]
        cells.append([name, *(", ".join(f"{of[a]} / {of[a + 1]}" for of in (robot, human)) for a in (3, 6, 0))])
    return markdown_table(["", "RMS error, mm", "mean sd over it", "coverage of the 95 % band"], cells)


ESTIMATORS: Final = {
    "geometry": "geometry",
    "kalman-thesis": "Kalman, thesis",
    "kalman": r"Kalman, jerk 20 m/s\(^3\)",
    "rts": "RTS, thesis' R",
    "complementary-thesis": "complementary, thesis",
    "complementary": "complementary, auto",
    "smoother": "smoother",
}
"""Estimators of the book and their names on the pages."""


def estimators_block(page: str) -> str:
    """RMS error with the thesis' noise, and lateral lag, of every estimator at both cadences."""
    errors = {(row[0], row[2]): row[3:] for row in read_table(page, "errors", "gait") if row[1] == "thesis"}
    lags = {(row[0], row[1]): row[3] for row in read_table(page, "lag", "gait | estimator")}
    rows = []
    for key, name in ESTIMATORS.items():
        row = [name]
        for gait in ("robot", "human"):
            x, y, z, horizontal, _ = errors[gait, key]
            row += [f"{x} / {y} / {z}", horizontal, lags[gait, key]]
        rows.append(row)
    heads = [head for gait in ("robot", "human") for head in (f"{gait} cadence", "horizontal", "lag y, ms")]
    return markdown_table(["", *heads], rows)


def lag_causes_block(page: str) -> str:
    """Lateral lag of the Kalman filter without noise, with each of its two causes removed, and with both."""
    lags = {(row[0], row[1]): row[2] for row in read_table(page, "lag", "gait | case")}
    cases = dict.fromkeys(case for _, case in lags)
    rows = [[case, f"{lags['robot', case]} ms", f"{lags['human', case]} ms"] for case in cases]
    return markdown_table(["", "robot", "human"], rows)


def three_axes_block(page: str) -> str:
    """Errors of two filters per axis, horizontally and in 3D, robot cadence, and their ratios."""
    errors = {row[2]: row[3:7] for row in read_table(page, "errors", "gait") if row[:2] == ["robot", "thesis"]}
    rows, sizes = [], []
    for key in ("kalman-thesis", "complementary-thesis"):
        x, y, z, horizontal = errors[key]
        size = sum(float(axis) ** 2 for axis in (x, y, z)) ** 0.5
        sizes.append((float(horizontal), size))
        rows.append([ESTIMATORS[key], f"{x} / {y} / {z}", horizontal, f"{size:.1f}"])
    ratios = [f"{second / first:.2f}" for first, second in zip(*sizes, strict=True)]
    heads = ["RMS error, mm", "x / y / z", "horizontal", "3D"]
    return markdown_table(heads, [*rows, ["second over first", "", *ratios]])


def height_block(page: str) -> str:
    """Correlations with the height over all steps of the adults."""
    items = ("fig-3.7-people", "fig-3.8-people", "fig-3.9-people")
    claims = [of for item in items for of in read_claims(page, item) if "correlat" in of.says and of.interval]
    rows = [[_letter_of(of.says), f"{of.ours} [{_bounds(of)}]", of.thesis] for of in claims]
    return markdown_table(["", "all steps, both speeds, height", "thesis"], rows)


def simulated_height_block(page: str) -> str:
    """The same correlations among simulated people."""
    claims = [of for item in ("fig-3.7", "fig-3.8", "fig-3.9") for of in read_claims(page, item)]
    rows = [[_letter_of(of.says), f"{of.ours} [{_bounds(of)}]", _people_of(of)] for of in claims]
    return markdown_table(["simulated people", "height", "n"], rows)


def one_model_block(page: str) -> str:
    """Exponents of the model of all people, and the verdicts that follow from it."""
    rows = [
        [name, f"{b} [{low}, {high}]", f"{c} [{c_low}, {c_high}]", between, within]
        for name, b, low, high, c, c_low, c_high, between, within in read_table(page, "height-people", "parameter")
    ]
    heads = ["", "exponent of the height, b", "exponent of the Froude number, c", "tau", "sigma"]
    claims = [(of.item, of.says) for of in read_claims(page, "height-people")]
    return "\n\n".join([markdown_table(heads, rows), claims_table(page, claims, remarks=True)])


def cones_block(page: str) -> str:
    """The thesis' cone and the largest inner cone on the stances of figure 4.5."""
    names = {"2 contacts": "two feet", "3 contacts": "and a hand", "4 contacts": "and two hands"}
    rows = [
        [names[who], alpha, at_02, at_03, at_max, ours, f"{100 * float(excess):.1f} %"]
        for who, alpha, at_02, at_03, at_max, ours, excess, *_ in read_table(page, "fig-4.6", "contacts")
    ]
    largest = r"\(\alpha_{max}\)"
    heads = ["contacts", largest, r"volume, \(\alpha\) = 0.2", "0.3", largest, "largest inner cone"]
    table = markdown_table([*heads, 'true cone exceeds "outer" by'], rows)
    words = ("the outer approximation", "with alpha = 1/5", "alpha = 0.3 is inside", "the same on random sets")
    return "\n\n".join([table, claims_table(page, [("fig-4.6", of) for of in words])])


def level_sets_block(page: str) -> str:
    """The 95 % sets of the mixtures against the kernel densities, and the verdicts of figures 4.2 and 4.4."""
    figures = {"fig-4.2": "HRP-2", "fig-4.4": "TALOS"}
    rows = [
        [robot, components, mass, kernels, unseen, volume]
        for item, robot in figures.items()
        for components, mass, kernels, unseen, volume in read_table(page, item, "components")
        if mass == "0.95"
    ]
    heads = ["right foot", "components", "mass of the mixture", "of the kernels", "of unseen samples"]
    wanted = [(item, words) for item in figures for words in ("maximal values", "to the support", "to the level sets")]
    return "\n\n".join([markdown_table([*heads, "volume over the kernels' set"], rows), claims_table(page, wanted)])


def weights_block(page: str) -> str:
    """Errors of the predicted centre of mass and force by the weights of (4.20a)."""
    rows = [
        [who, *errors, f"{100 * float(force):.1f}"]
        for who, *errors, force in read_table(page, "weights-people", "weights | ahead mm")
    ]
    heads = ["weights", "ahead, mm", "sideways, mm", "up, mm", "distance, mm", "force, % of weight"]
    return markdown_table(heads, rows)


def weight_ratios_block(page: str) -> str:
    """Ratios of these errors with their intervals, of all groups of people."""
    return claims_table(page, [(of.item, of.says) for of in read_claims(page, "weights-people")], remarks=True)


def talos_weights_block(page: str) -> str:
    """Plans of TALOS with the weights of people."""
    heads = ["weights", "sway, mm", "height, range, mm", "speed, range over mean"]
    rows = read_table(page, "weights-people", "weights | sway mm")
    return markdown_table([*heads, "rate of angular momentum, RMS, N m", "vertical force, SD over mean"], rows)


def occupancy_block(page: str) -> str:
    """Largest change of each log-density within a phase, by motion, and the verdicts on their ratios."""
    names = {"1": "long strides", "2": "six stairs", "3": "stairs with a rail"}
    rows = [[names[number], *nats] for number, *nats in read_table(page, "occupancy", "experiment | position nats")]
    heads = ["motion", r"position, \(\sum \log p_i(c)\)", r"\((\dot c, L_c)\)", r"\((\ddot c, \dot L_c)\)"]
    wanted = [("occupancy", "log-density of (c', L) changes"), ("occupancy", "log-density of (c'', L') changes")]
    return "\n\n".join([markdown_table(heads, rows), claims_table(page, wanted)])


def optima_block(page: str) -> str:
    """Optima of (4.20a) with forces and with the wrench as control, and how far their paths are apart."""
    cells = {tuple(row[:3]): row[4:] for row in read_table(page, "fig-4.8", "robot | experiment | control | solver")}
    motions = {"1": "long stride", "2": "six stairs", "3": "rail"}
    rows = []
    for robot, number in dict.fromkeys((key[0], key[1]) for key in cells):
        of_forces, of_wrench = cells[robot, number, "u_f"], cells[robot, number, "u_c"]
        name = {"hrp2": "HRP-2", "talos": "TALOS"}[robot]
        both = [f"{of[0]}; {of[1]}" for of in (of_forces, of_wrench)]
        rows.append([f"{motions[number]}, {name}", *both, f"{of_wrench[3]} mm"])
    return markdown_table(["(4.20a); iterations of ipopt", "u_f", "u_c", "paths apart"], rows)


def _letter_of(says: str) -> str:
    return "omega" if "angular velocity" in says else says.partition(" ")[0]


def _bounds(claim: ClaimRow) -> str:
    return claim.interval.replace(" to ", ", ")


def _people_of(claim: ClaimRow) -> str:
    return claim.basis.partition("n = ")[2].partition(";")[0]


TUNING: Final = (
    ("numbers-2", "robot gait: with a jerk of 1 m/s³"),
    ("numbers-2", "human gait: with a jerk of 1 m/s³"),
    ("lag", "robot gait: lag of the thesis' Kalman filter"),
    ("lag", "human gait: lag of the thesis' Kalman filter"),
)
RUNNERS: Final = (
    ("fig-2.9-people", "(along the run): the offset is the same"),
    ("fig-2.9-people", "(to the left): the offset is the same"),
    ("fig-2.9-people", "(up): the offset is the same"),
)
CROSSINGS: Final = tuple(
    ("fig-3.10-people", f"{speed} speed: {words}")
    for speed in ("comfortable", "fast")
    for words in ("the start of double", "the end of double", "the crossings")
)
LITERATURE: Final = (("numbers-3-people", "one order of magnitude"),)
WHEEL: Final = (
    ("fig-3.6-people", "comfortable speed: the mean reconstruction"),
    ("fig-3.6-people", "fast speed: the mean reconstruction"),
    ("fig-3.5-people", "comfortable speed: over the whole cycle"),
    ("fig-3.5-people", "fast speed: over the whole cycle"),
    *LITERATURE,
    ("numbers-3", "only three parameters"),
    ("fig-3.9-people", "comfortable speed: theta can be well approximated"),
    ("fig-3.9-people", "fast speed: theta can be well approximated"),
    ("fig-3.7-people", "R only depends on the height"),
    ("fig-3.7-people", "r only depends on the height"),
    ("fig-3.8-people", "z0 only depends on the height"),
    *CROSSINGS,
    ("numbers-3-people", "comfortable speed: the centre of the wheel hovers"),
    ("numbers-3-people", "fast speed: the centre of the wheel hovers"),
)
LATENCY: Final = (
    ("real-walks", "adults, comfortable: median latency"),
    ("real-walks", "adults, fast: median latency"),
    ("real-walks", "children: median latency"),
)

BLOCKS: Final[Mapping[tuple[str, str], Callable[[str], str]]] = {
    ("theory/centroidal-problem.md", "optima"): optima_block,
    ("theory/human-weights.md", "weights"): weights_block,
    ("theory/human-weights.md", "ratios"): weight_ratios_block,
    ("theory/human-weights.md", "talos"): talos_weights_block,
    ("theory/kalman-filter.md", "estimators"): estimators_block,
    ("theory/kalman-filter.md", "lag"): lag_causes_block,
    ("theory/misprints.md", "tuning"): partial(claims_table, chosen=TUNING),
    ("theory/misprints.md", "runners"): partial(claims_table, chosen=RUNNERS),
    ("theory/misprints.md", "crossings"): partial(claims_table, chosen=CROSSINGS),
    ("theory/misprints.md", "literature"): partial(claims_table, chosen=LITERATURE, remarks=True),
    ("theory/pitfalls.md", "axes"): three_axes_block,
    ("theory/population.md", "height"): height_block,
    ("theory/population.md", "simulated"): simulated_height_block,
    ("theory/population.md", "model"): one_model_block,
    ("theory/proxy.md", "occupancy"): occupancy_block,
    ("theory/reachability.md", "sets"): level_sets_block,
    ("theory/rolling-wheel.md", "wheel"): partial(claims_table, chosen=WHEEL),
    ("theory/smoother.md", "coverage"): coverage_block,
    ("theory/synchronisation.md", "latency"): partial(claims_table, chosen=LATENCY),
    ("theory/wrench-cones.md", "cones"): cones_block,
}
"""Tables of other pages of the docs: page, name of the table between its comments, and the function that writes it."""
