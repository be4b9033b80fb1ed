"""Markdown page of the items: claims with their remarks and short tables, without drawings.

Tables of other pages that repeat numbers of this one are written between two comments (``reproduction_blocks``).
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from stridelab.reproduction.claims import WORDS, Claim, Column
from stridelab.reproduction.report.formatting import basis_text, claim_numbers, holds_text, table_cells
from stridelab.reproduction.runner import Section

COLUMNS: Final = ("claim", "place", "thesis", "holds if", "ours", "", "evidence")


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
    code = f" Code and models: `{section.code}`." if section.code else ""
    again = [f"Computed again by `{section.command}`.{code}", ""] if section.command else []
    lines += [
        f"{result.note} {section.sampling}",
        "",
        *again,
        f"| {' | '.join(COLUMNS)} |",
        f"|{' --- |' * len(COLUMNS)}",
    ]
    lines += [_claim_row(claim) for claim in result.claims]
    lines += ["", *(f"- {claim.says}: {claim.note}" for claim in result.claims if claim.note)]
    for key in section.printed:
        lines += ["", *_markdown_table(result.tables[key])]
    return "\n".join(lines) + "\n"


def codes_of(page: str) -> dict[str, str]:
    """Digest of the code and models that computed each section, by item; empty for a section that does not state it."""
    stated = re.compile(r"^Computed again by .* Code and models: `(\w+)`\.$", re.MULTILINE)
    sections = {part.partition(":")[0]: stated.search(part) for part in page.split("\n## ")[1:]}
    return {name: "" if match is None else match[1] for name, match in sections.items()}


def other_seeds_block(sections: Sequence[Section], others: Sequence[Section]) -> str:
    """Claims whose outcome is another one in ``others``, the same items computed with other seeds."""
    lines, total, first = [], 0, {section.name: section for section in sections}
    for other in others:
        section = first[other.name]
        assert section.result is not None
        assert other.result is not None
        claims = {claim.key: claim for claim in section.result.claims}
        total += len(claims)
        for claim in other.result.claims:
            before = claims[claim.key]
            if claim.outcome != before.outcome:
                numbers = f"{claim_numbers(before)[1]} | {claim_numbers(claim)[1]}"
                words = f"{WORDS[before.outcome]} | {WORDS[claim.outcome]}"
                lines.append(f"| {section.name} | {claim.says.replace('|', 'or')} | {numbers} | {words} |")
    sampling = " ".join(dict.fromkeys(other.sampling for other in others)).rstrip(".")
    names = ", ".join(other.name for other in others)
    head = f"{total - len(lines)} of {total} verdicts are the same with other seeds ({sampling}; {names})"
    if not lines:
        return f"{head}."
    heads = ["| item | claim | here | other seeds | verdict | other seeds |", f"|{' --- |' * 6}"]
    return "\n".join([f"{head}, all but these:", "", *heads, *lines])


def _claim_row(claim: Claim) -> str:
    thesis, ours = claim_numbers(claim)
    verdict = "**not met**" if claim.outcome == "not_met" else WORDS[claim.outcome]
    says, place = claim.says.replace("|", "or"), claim.where or "ours"
    return f"| {says} | {place} | {thesis} | {holds_text(claim)} | {ours} | {verdict} | {basis_text(claim)} |"


def _markdown_table(columns: Mapping[str, Column]) -> list[str]:
    heads, rows = table_cells(columns)
    return [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]


def insert_block(text: str, name: str, block: str) -> str:
    """The text of a page with a table between its comments; raises ``KeyError`` if the page has not both."""
    begin, end = f"<!-- {name} of reproduction.md -->", f"<!-- end of {name} -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise KeyError(name)
    return f"{before}{begin}\n\n{block}\n\n{end}{after}"
