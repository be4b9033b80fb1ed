"""Self-contained HTML report: summary of the verdicts, then claims, tables and drawing of every item."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from stridelab.reproduction.claims import OUTCOMES, WORDS, Claim, Column, Reproduction
from stridelab.reproduction.report.formatting import (
    basis_text,
    claim_numbers,
    count_outcomes,
    holds_text,
    overturned_by,
    table_cells,
)
from stridelab.reproduction.runner import Section

STYLE: Final = """
:root { color-scheme: light dark; --line: #8886; --good: #0b7a4b; --bad: #b3261e; --odd: #8a5a00; }
@media (prefers-color-scheme: dark) { :root { --good: #58d29b; --bad: #ff9a91; --odd: #f0c060; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1, h2 { line-height: 1.2; } section { border-top: 1px solid var(--line); margin-top: 2rem; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .25rem .75rem .25rem 0; vertical-align: top; }
th { border-bottom: 1px solid var(--line); }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
small { display: block; opacity: .75; } .scroll { overflow-x: auto; } figure { margin: 1rem 0; }
svg { max-width: 100%; height: auto; }
.met, .beaten, .aim_reached { color: var(--good); } .not_met, .aim_missed, .failed { color: var(--bad); }
.thesis_in_error, .undecided, .aim_undecided { color: var(--odd); }
"""


def render_html(sections: Sequence[Section], generated_by: str) -> str:
    """Render the report; ``generated_by`` is a sentence on how it was generated."""
    intro = (
        "Every claim has its place in the thesis, the thesis' number, or an aim of our own where it has none, the "
        "range in which it holds, our number, and a computed verdict."
    )
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
        f"<title>Reproduction of the thesis</title><style>{STYLE}</style></head><body>",
        "<h1>Reproduction of the thesis</h1>",
        f"<p>{escape(generated_by)} {intro}</p>",
        _verdict_summary(sections),
        *(_render_section(section) for section in sections),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _verdict_summary(sections: Sequence[Section]) -> str:
    """Number of claims by verdict, in total and by item."""
    results = [section.result for section in sections if section.result is not None]
    total = count_outcomes(claim for result in results for claim in result.claims)
    counts = ", ".join(f'<b class="{v}">{total[v]}</b> {WORDS[v]}' for v in reversed(OUTCOMES))
    failed = [section for section in sections if section.result is None]
    missing = f' <b class="failed">{len(failed)} item{"s"[: len(failed) > 1]} failed.</b>' if failed else ""
    heads = "".join(f'<th class="n" scope="col">{WORDS[v]}</th>' for v in reversed(OUTCOMES))
    rows = "".join(_summary_row(section) for section in sections)
    return (
        f"<p data-counts>{sum(total.values())} claims of {len(sections)} items: {counts}.{missing}</p>"
        f'<div class="scroll"><table><thead><tr><th scope="col">Item</th>{heads}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _summary_row(section: Section) -> str:
    link = f'<a href="#{escape(section.name)}">{escape(section.name)}</a> {escape(section.title)}'
    if section.result is None:
        return f'<tr><td>{link}</td><td class="failed" colspan="{len(OUTCOMES)}">failed</td></tr>'
    counts = count_outcomes(section.result.claims)
    numbers_ = "".join(f'<td class="n {v if counts[v] else ""}">{counts[v] or ""}</td>' for v in reversed(OUTCOMES))
    return f"<tr><td>{link}</td>{numbers_}</tr>"


def _render_section(section: Section) -> str:
    head = f'<section id="{escape(section.name)}"><h2>{escape(section.name)}: {escape(section.title)}</h2>'
    if section.result is None:
        return f'{head}<p class="failed">Not computed: {escape(section.failure)}</p></section>'
    tables = "".join(_render_table(section.result.tables[name]) for name in section.printed)
    return f"{head}{_claims_table(section.result, section)}{tables}{_figure_html(section)}</section>"


def _claims_table(result: Reproduction, section: Section) -> str:
    rows = "".join(_claim_row(claim) for claim in result.claims)
    heads = (
        '<th scope="col">Claim</th><th class="n" scope="col">Thesis, or our aim</th><th class="n" scope="col">Holds if'
        '</th><th class="n" scope="col">Here'
    )
    code = f" Code and models: <code>{section.code}</code>." if section.code else ""
    again = f"<p>Computed again by <code>{escape(section.command)}</code>.{code}</p>" if section.command else ""
    return (
        f'<p>{escape(f"{result.note} {section.sampling}")}</p>{again}<div class="scroll"><table><thead><tr>{heads}</th>'
        f'<th scope="col">Verdict</th></tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _claim_row(claim: Claim) -> str:
    thesis, ours = claim_numbers(claim)
    texts = (claim.where, claim.note, basis_text(claim), overturned_by(claim))
    remark = "".join(f"<small>{escape(text)}</small>" for text in texts if text)
    return (
        f'<tr><td>{escape(claim.says)}{remark}</td><td class="n">{escape(thesis)}</td>'
        f'<td class="n">{escape(holds_text(claim))}</td><td class="n">{escape(ours)}</td>'
        f'<td class="{claim.outcome}">{WORDS[claim.outcome]}</td></tr>'
    )


def _render_table(columns: Mapping[str, Column]) -> str:
    heads, rows = table_cells(columns)
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in heads)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _figure_html(section: Section) -> str:
    """Embed the SVG unchanged; it contains neither scripts nor styles."""
    assert section.result is not None
    return f'<figure aria-label="{escape(section.title)}, drawn from these numbers">{section.result.drawing}</figure>'
