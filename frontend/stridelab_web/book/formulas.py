"""Formulas in TeX become MathML, which browsers show without a script."""

import html

from latex2mathml.converter import convert


def mathml(tex: str, *, block: bool = False) -> str:
    """A formula as MathML. Raises ``ValueError`` for commands that the converter does not know."""
    made = convert(html.unescape(tex).strip(), display="block" if block else "inline")
    if "\\" in made:
        raise ValueError(f"not understood: {tex}")
    return made
