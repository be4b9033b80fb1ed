"""Markdown page of the items: claims with their remarks and short tables, without drawings."""

from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.reproduction.claims import Claim, Column
from stridelab.reproduction.report.formatting import cells, numbers
from stridelab.reproduction.runner import Section

WORDS: Final = {"met": "met", "beaten": "met", "not_met": "**not met**", "thesis_in_error": "thesis in error"}


def page(head: str, sections: Sequence[Section]) -> str:
    """Render the page below a ``head`` in Markdown."""
    return "\n".join([head, *(section_text(section) for section in sections)])


def section_text(section: Section) -> str:
    """Heading, note, claims with their remarks and tables; the error message for a failed item."""
    lines = [f"## {section.name}: {section.title}", ""]
    if section.found is None:
        return "\n".join([*lines, f"**Not computed**: {section.failure}"]) + "\n"
    result = section.found
    lines += [result.note, "", "| claim | thesis | ours | |", "| --- | --- | --- | --- |"]
    lines += [_row(claim) for claim in result.claims]
    lines += ["", *(f"- {claim.says}: {claim.note}" for claim in result.claims if claim.note)]
    for key in section.printed:
        lines += ["", *_table(result.tables[key])]
    return "\n".join(lines) + "\n"


def _row(claim: Claim) -> str:
    thesis, ours = numbers(claim)
    return f"| {claim.says.replace('|', 'or')} | {thesis} | {ours} | {WORDS[claim.verdict]} |"


def _table(columns: Mapping[str, Column]) -> list[str]:
    heads, rows = cells(columns)
    return [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]
