"""Draw people, score estimators with and without the truth, and write what came of it as a page.

make_score_agreement.py ROWS [N]   N draws (default 210) into the file ROWS, those that are missing; then the page
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from experiments.people.movements import MOVEMENTS
from experiments.score_agreement import Agreement, ScoredDraw, score_agreement, score_draw
from stridelab.errors import StridelabError
from stridelab.reproduction.report.svg_plots import Bars, render_svg

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE, PICTURE = DOCS / "theory" / "judging-estimators.md", DOCS / "pictures" / "score-agreement.svg"
FIRST_SEED = 1000
SURVIVOR = "force path, penalty"
AXES = {"horizontally": (0, 1), "along the walk": (0,), "lateral": (1,), "vertical, moving part": (2,)}
INTRO, OUTRO = "<!-- figures: begin -->", "<!-- figures: end -->"


def main() -> None:
    """Draw what is missing, and write the figures into the page."""
    rows = Path(sys.argv[1])
    seeds = range(FIRST_SEED, FIRST_SEED + int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED + 210)
    lines = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    with rows.open("a") as out:
        for seed in sorted(set(seeds) - {line["seed"] for line in lines}):
            try:
                line = asdict(score_draw(seed))
            except StridelabError as error:
                line = {"seed": seed, "refused": error.code}
            lines.append(line)
            out.write(json.dumps(line) + "\n")
            out.flush()
    draws = [ScoredDraw(**line) for line in sorted(lines, key=lambda line: line["seed"]) if "refused" not in line]
    refused = [line["refused"] for line in lines if "refused" in line]
    before, _, rest = PAGE.read_text().partition(INTRO)
    after = rest.partition(OUTRO)[2]
    PAGE.write_text(f"{before}{INTRO}\n\n{_figures(draws, refused)}\n{OUTRO}{after}")
    PICTURE.write_text(_picture(draws))


def _figures(draws: Sequence[ScoredDraw], refused: Sequence[str]) -> str:
    counts = ", ".join(f"{sum(d.movement == m for d in draws)} {m}" for m in MOVEMENTS)
    path_mm = 1e3 * np.sqrt(np.mean([d.path_m2 for d in draws], axis=0))
    text = [
        (
            f"{len(draws)} draws ({counts}; {sum(d.loaded for d in draws)} with an unseen load); {len(refused)} more "
            f"were refused by an estimator ({', '.join(sorted(set(refused))) or 'none'}). RMS error of the force path "
            f"itself: {path_mm[0]:.1f} mm along, {path_mm[1]:.1f} mm lateral."
        ),
        "",
        "True RMS error in mm, along / lateral / vertical (moving part):",
        "",
        "| | " + " | ".join(draws[0].scores) + " |",
        "| --- " * (1 + len(draws[0].scores)) + "|",
    ]
    for movement in (*MOVEMENTS, None):
        part = [d for d in draws if movement in (None, d.movement)]
        cells = [
            " / ".join(f"{v:.1f}" for v in 1e3 * np.sqrt(np.mean([d.scores[name]["truth"] for d in part], axis=0)))
            for name in draws[0].scores
        ]
        text.append(f"| {movement or 'all'} | " + " | ".join(cells) + " |")
    names = [name for name in _score_names(draws) if name != "truth"]
    for label, axes in AXES.items():
        text += ["", f"### {label[0].upper()}{label[1:]}", "", *_agreement_table(draws, names, axes)]
    text += ["", "### Stated sizes half and twice the true ones", "", *_sensitivity_table(draws)]
    return "\n".join(text) + "\n"


def _score_names(draws: Sequence[ScoredDraw]) -> list[str]:
    names: dict[str, None] = {}
    for draw in draws:
        names |= dict.fromkeys(next(iter(draw.scores.values())))
    return list(names)


def _agreement_table(draws: Sequence[ScoredDraw], names: Sequence[str], axes: Sequence[int]) -> list[str]:
    agreements = [score_agreement(draws, name, axes) for name in names]
    return [
        "| score | draws | rank correlation | pairs | same order: 1, 10, 40 people | best: 1, 10, 20, 40 people |",
        "| --- | --- | --- | --- | --- | --- |",
        *(_agreement_row(each) for each in agreements),
    ]


def _agreement_row(each: Agreement) -> str:
    order = ", ".join(f"{each.same_order[n]:.2f}" for n in (1, 10, 40))
    best = ", ".join(f"{each.same_best[n]:.2f}" for n in (1, 10, 20, 40))
    name = f"**{each.score}**" if each.score == SURVIVOR else each.score
    return f"| {name} | {each.draws} | {each.rank_correlation:.2f} | {each.pairs:.2f} | {order} | {best} |"


def _sensitivity_table(draws: Sequence[ScoredDraw]) -> list[str]:
    """Horizontal agreement with the penalty scaled as if the stated errors were half and twice as large."""
    lines = [
        "| stated sizes | pairs | same order: 1, 10, 40 people | best: 1, 10, 20, 40 people |",
        "| --- | --- | --- | --- |",
    ]
    for factor in (0.0, 0.5, 1.0, 2.0):
        scaled = []
        for draw in draws:
            scores = {}
            for name, of_one in draw.scores.items():
                distance, square = np.array(of_one["force path"]), np.array(of_one[SURVIVOR])
                scores[name] = {
                    "truth": of_one["truth"],
                    "scaled": (distance + factor**2 * (square - distance)).tolist(),
                }
            scaled.append(replace(draw, scores=scores))
        each = score_agreement(scaled, "scaled", (0, 1))
        cells = _agreement_row(each).split(" | ")[3:]
        lines.append(f"| times {factor:g} | " + " | ".join(cells))
    return lines


def _picture(draws: Sequence[ScoredDraw]) -> str:
    names = [name for name in _score_names(draws) if name != "truth"]
    bars = [(name, 100.0 * score_agreement(draws, name, (0, 1)).same_best[20]) for name in names]
    title = "Groups of 20 people in which the score picks an estimator within 5 % of the truly best, horizontally"
    return render_svg(Bars(title, "%", bars))


if __name__ == "__main__":
    main()
