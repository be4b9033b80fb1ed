"""Parses XML without document types and entities, in bounded memory; elements that are not needed are skipped."""

import re
from collections.abc import Collection
from typing import Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 2_000_000
_HEAD: Final = 10_000
"""A comment of up to this length may stand before the XML declaration: some programs write a licence there."""
_BARE_AMPERSAND: Final = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[\da-fA-F]+);)")
"""Occurs in the credits of models; programs of biomechanics accept it."""


class BrokenXmlError(ValueError):
    """An XML text that is not read; the message completes a sentence for users."""


def parse_xml(text: str, skipped: Collection[str] = ()) -> Element:
    """Root of the tree of an XML text, without the elements named in ``skipped`` and all that is in them.

    Raises ``BrokenXmlError`` for a text that is not well-formed, that has a document type (and so could define
    entities), that is nested deeper than ``MAX_DEPTH``, or that has more than ``MAX_ELEMENTS`` elements.
    """
    builder = TreeBuilder()
    parser = expat.ParserCreate("utf-8")
    depth = n_elements = skipped_from = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, n_elements, skipped_from
        depth, n_elements = depth + 1, n_elements + 1
        if depth > MAX_DEPTH or n_elements > MAX_ELEMENTS:
            raise BrokenXmlError(f"it has over {MAX_ELEMENTS} elements, or over {MAX_DEPTH} inside each other")
        if not skipped_from and tag in skipped:
            skipped_from = depth
        if not skipped_from:
            builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth, skipped_from
        if not skipped_from:
            builder.end(tag)
        elif skipped_from == depth:
            skipped_from = 0
        depth -= 1

    def data(content: str) -> None:
        if not skipped_from:
            builder.data(content)

    def refuse(*_: object) -> None:
        raise BrokenXmlError("it has a document type, which is not read")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, data
    parser.StartDoctypeDeclHandler = refuse
    try:
        start_at = max(text[:_HEAD].find("<?xml"), 0)
        parser.Parse(_BARE_AMPERSAND.sub("&amp;", text[start_at:]).encode("utf-8", errors="replace"), True)
        return builder.close()
    except expat.ExpatError as error:
        raise BrokenXmlError(f"line {error.lineno} is not well-formed XML ({expat.ErrorString(error.code)})") from error
