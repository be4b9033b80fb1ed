"""Formulas in TeX become MathML while the book is built: a browser shows them without a script from elsewhere."""

import re

from stridelab_web.book.formulas import mathml

MARKED = re.compile(r'<(span|div) class="arithmatex">\\[\[(](.*?)\\[\])]</\1>', re.DOTALL)
IN_TITLE = re.compile(r"\\\((.*?)\\\)")


def in_page(text: str) -> str:
    """HTML of a page with all formulas that arithmatex has marked; one of its own line scrolls where it is too long."""

    def shown(match: re.Match[str]) -> str:
        if match[1] == "span":
            return mathml(match[2])
        return f'<div class="md-typeset__scrollwrap">{mathml(match[2], block=True)}</div>'

    return MARKED.sub(shown, text)


def in_title(text: str) -> str:
    """A heading as the table of contents has it."""
    return IN_TITLE.sub(lambda m: mathml(m[1]), text)
