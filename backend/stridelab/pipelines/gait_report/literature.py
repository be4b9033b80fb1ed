"""The literature of ``models/references.bib`` as plain text."""

import re
import unicodedata
from functools import cache
from typing import Final

from stridelab.machine.models_folder import models_dir

_ENTRY: Final = re.compile(r"^@\w+\{([^,\s]+),(.*?)^\}", re.MULTILINE | re.DOTALL)
_FIELD: Final = re.compile(r"^\s*(\w+)\s*=\s*\{(.*)\},?\s*$", re.MULTILINE)


@cache
def _read_entries() -> dict[str, dict[str, str]]:
    text = (models_dir() / "references.bib").read_text(encoding="utf-8")
    return {key: dict(_FIELD.findall(body)) for key, body in _ENTRY.findall(text)}


def reference_text(key: str) -> str:
    """Authors, title, journal, year and DOI of a citation key of ``models/references.bib``."""
    fields = _read_entries()[key]
    authors = [name.split(",")[0] for name in _without_tex(fields["author"]).split(" and ")]
    named = ", ".join(authors[:3]) + (" et al." if len(authors) > 3 else "")
    place = next((fields[name] for name in ("journal", "booktitle", "publisher", "school") if name in fields), "")
    parts = (f"{named} ({fields.get('year', '')})", fields["title"], place, fields.get("doi", ""))
    return _without_tex(". ".join(part for part in parts if part)) + "."


def _without_tex(text: str) -> str:
    accents = {"'": "\u0301", "`": "\u0300", '"': "\u0308", "^": "\u0302", "~": "\u0303"}
    composed = re.sub(r"\{?\\([\"'`^~])\{?(\w)\}?\}?", lambda m: m[2] + accents[m[1]], text)
    plain = re.sub(r"[{}]", "", composed).replace("---", "-").replace("--", "-").replace("\\&", "&")
    return unicodedata.normalize("NFC", plain)
