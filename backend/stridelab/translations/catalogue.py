"""The translations of pages and reports: the language of what is being written, and its texts.

English is the text in the code, the templates and the scripts; ``*.po`` in this folder contain the others, which
``scripts/translate`` updates.
"""

import contextlib
import io
import re
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from functools import cache
from gettext import GNUTranslations, NullTranslations
from pathlib import Path
from typing import Final

from babel.messages.catalog import Catalog
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po

from stridelab.schemas.service import Language
from stridelab.translations.served_sentences import SERVED

ENGLISH: Final[Language] = "en"
LANGUAGES: Final[Mapping[Language, str]] = {"en": "English", "de": "Deutsch", "fr": "Français", "ja": "日本語"}
"""The languages by code, each with its own name."""
FOLDER: Final = Path(__file__).parent
_FORMAT: Final = re.compile(r"%\((\w+)\)[sd]")

_language: ContextVar[Language] = ContextVar("language", default=ENGLISH)


def current_language() -> Language:
    """The language of the page or report that is being written."""
    return _language.get()


@contextlib.contextmanager
def in_language(language: Language) -> Iterator[None]:
    """Everything inside is translated into ``language``."""
    token = _language.set(language)
    try:
        yield
    finally:
        _language.reset(token)


@cache
def read_catalogue(language: Language) -> Catalog:
    """The translations into ``language``; empty for English."""
    if language == ENGLISH:
        return Catalog(locale=ENGLISH)
    with (FOLDER / f"{language}.po").open("rb") as file:
        return read_po(file, locale=language)


@cache
def read_translations(language: Language) -> NullTranslations:
    """The catalogue of ``language`` as the standard library uses it."""
    if language == ENGLISH:
        return NullTranslations()
    compiled = io.BytesIO()
    write_mo(compiled, read_catalogue(language))
    compiled.seek(0)
    return GNUTranslations(compiled)


def translate_text(message: str) -> str:
    """The translation of ``message``; the English text itself where there is none."""
    return read_translations(current_language()).gettext(message) if message else message


def translate_count(one: str, many: str, number: int) -> str:
    """The plural form of a message for ``number``."""
    return read_translations(current_language()).ngettext(one, many, number)


def gettext(message: str, **values: object) -> str:
    """The translation of ``message`` with ``values`` at its places ``%(name)s``."""
    text = translate_text(message)
    return text % values if values else text


def ngettext(one: str, many: str, num: int, **values: object) -> str:
    """The translation for a number with ``num`` and ``values`` at its places."""
    return translate_count(one, many, num) % {"num": num, **values}


def translate_sentence(sentence: str, patterns: tuple[str, ...] = SERVED) -> str | None:
    """The translation of a sentence of the service that one of ``patterns`` matches; None without one.

    ``%(name)s`` in a pattern stands for any text, which the translation repeats. What ``%(part_name)s`` stands for is
    translated by the same patterns, and so are the items of a ``%(list_name)s``.
    """
    catalogue = read_catalogue(current_language())
    for pattern in patterns:
        match = _pattern_of(pattern).fullmatch(sentence)
        if match is not None and pattern in catalogue:
            text = translate_text(pattern)
            values = {name: _translated_value(name, value, patterns) for name, value in match.groupdict().items()}
            if None not in values.values():
                return text % values if values else text
    return None


def _translated_value(name: str, value: str, patterns: tuple[str, ...]) -> str | None:
    """The translation of what stands at the place ``name``; None if it is a sentence without one."""
    if name == "checks":
        return _translated_checks(value)
    if name.startswith("part_"):
        return translate_sentence(value, patterns)
    if name.startswith("list_"):
        items = [translate_sentence(item, patterns) for item in value.split(", ")]
        return None if None in items else ", ".join(filter(None, items))
    return value.replace(" to ", gettext(" to ")).replace(" and ", ", ") if name.startswith("span_") else value


def _translated_checks(listed: str) -> str:
    """The checks that a verdict lists, as ``a, b and 2 more``."""
    if more := re.fullmatch(r"(.+) and (\d+) more", listed):
        return gettext("%(checks)s and %(number)s more", checks=_translated_checks(more[1]), number=more[2])
    return ", ".join(translate_text(label) for label in listed.split(", "))


@cache
def _pattern_of(pattern: str) -> re.Pattern[str]:
    parts = _FORMAT.split(pattern)
    texts = [re.escape(part) if k % 2 == 0 else f"(?P<{part}>.+?)" for k, part in enumerate(parts)]
    return re.compile("".join(texts), re.DOTALL)
