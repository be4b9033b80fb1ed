"""Markdown page of the items: claims with their remarks and short tables, without drawings."""

from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.reproduction.claims import Claim, Column
from stridelab.reproduction.report.formatting import claim_numbers, table_cells
from stridelab.reproduction.runner import Section

WORDS: Final = {"met": "met", "beaten": "met", "not_met": "**not met**", "thesis_in_error": "thesis in error"}


def render_markdown(head: str, sections: Sequence[Section]) -> str:
    """Render the page below a ``head`` in Markdown."""
    return "\n".join([head, *(section_text(section) for section in sections)])


def section_text(section: Section) -> str:
    """Heading, note, claims with their remarks and tables; the error message for a failed item."""
    lines = [f"## {section.name}: {section.title}", ""]
    if section.result is None:
        return "\n".join([*lines, f"**Not computed**: {section.failure}"]) + "\n"
    result = section.result
    lines += [result.note, "", "| claim | thesis | ours | |", "| --- | --- | --- | --- |"]
    lines += [_claim_row(claim) for claim in result.claims]
    lines += ["", *(f"- {claim.says}: {claim.note}" for claim in result.claims if claim.note)]
    for key in section.printed:
        lines += ["", *_markdown_table(result.tables[key])]
    return "\n".join(lines) + "\n"


def _claim_row(claim: Claim) -> str:
    thesis, ours = claim_numbers(claim)
    return f"| {claim.says.replace('|', 'or')} | {thesis} | {ours} | {WORDS[claim.verdict]} |"


def _markdown_table(columns: Mapping[str, Column]) -> list[str]:
    heads, rows = table_cells(columns)
    return [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]
