"""Markdown page of the items: claims with their remarks and short tables, without drawings."""

from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.reproduction.claims import WORDS, Claim, Column
from stridelab.reproduction.report.formatting import basis_text, claim_numbers, table_cells
from stridelab.reproduction.runner import Section

COLUMNS: Final = ("claim", "thesis", "ours", "", "evidence")


def render_markdown(head: str, sections: Sequence[Section]) -> str:
    """Render the page below a ``head`` in Markdown."""
    return "\n".join([head, *(section_text(section) for section in sections)])


def replace_sections(page: str, sections: Sequence[Section]) -> str:
    """The page with new texts of ``sections``; all others stay as they are, and sections that it lacks come last."""
    head, *parts = page.split("\n## ")
    new = {section.name: section_text(section).removeprefix("## ") for section in sections}
    names = [part.partition(":")[0] for part in parts]
    texts = [new.get(name, part) for name, part in zip(names, parts, strict=True)]
    return "\n## ".join([head, *texts, *(text for name, text in new.items() if name not in names)])


def section_text(section: Section) -> str:
    """Heading, note, claims with their remarks and tables; the error message for a failed item."""
    lines = [f"## {section.name}: {section.title}", ""]
    if section.result is None:
        return "\n".join([*lines, f"**Not computed**: {section.failure}"]) + "\n"
    result = section.result
    lines += [f"{result.note} {section.sampling}", "", f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}"]
    lines += [_claim_row(claim) for claim in result.claims]
    lines += ["", *(f"- {claim.says}: {claim.note}" for claim in result.claims if claim.note)]
    for key in section.printed:
        lines += ["", *_markdown_table(result.tables[key])]
    return "\n".join(lines) + "\n"


def _claim_row(claim: Claim) -> str:
    thesis, ours = claim_numbers(claim)
    verdict = "**not met**" if claim.outcome == "not_met" else WORDS[claim.outcome]
    return f"| {claim.says.replace('|', 'or')} | {thesis} | {ours} | {verdict} | {basis_text(claim)} |"


def _markdown_table(columns: Mapping[str, Column]) -> list[str]:
    heads, rows = table_cells(columns)
    return [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]
