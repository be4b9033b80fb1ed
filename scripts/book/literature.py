"""models/references.bib as a page, with what cites each entry."""

import re
from functools import cache
from pathlib import Path

ENTRY = re.compile(r"^@(\w+)\{([^,\s]+),(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^\s*(\w+)\s*=\s*\{(.*)\},?\s*$", re.MULTILINE)
ACCENTS = {"'": "\u0301", "`": "\u0300", '"': "\u0308", "^": "\u0302", "~": "\u0303"}


@cache
def entries(root: Path) -> dict[str, dict[str, str]]:
    """Fields by citation key."""
    text = (root / "models" / "references.bib").read_text(encoding="utf-8")
    return {key: {"kind": kind, **dict(FIELD.findall(body))} for kind, key, body in ENTRY.findall(text)}


def plain(latex: str) -> str:
    """Without TeX: accents composed, braces and dashes as they read."""
    text = re.sub(r"\{?\\([\"'`^~])\{?(\w)\}?\}?", lambda m: m[2] + ACCENTS[m[1]], latex)
    text = re.sub(r"\\textsuperscript\{([^}]*)\}", r"\1", text)
    return text.replace("{", "").replace("}", "").replace("---", "—").replace("--", "–").replace("\\&", "&")


def people(authors: str) -> str:
    """Given name last becomes given name first."""
    names = [" ".join(reversed(name.split(", ", 1))) for name in plain(authors).split(" and ")]
    return ", ".join(names)


def written(fields: dict[str, str]) -> str:
    """An entry as a sentence."""
    inside = fields.get("journal") or fields.get("booktitle") or fields.get("publisher") or fields.get("school") or ""
    volume = fields.get("volume", "") + (f"({fields['number']})" if "number" in fields else "")
    parts = [plain(inside), volume, plain(fields.get("pages", "")), fields.get("year", "")]
    text = f"{people(fields['author'])}: *{plain(fields['title'])}*. {', '.join(p for p in parts if p)}."
    doi = fields.get("doi")
    return f"{text} [doi:{doi}](https://doi.org/{doi})" if doi else text


def citing_places(root: Path) -> dict[str, list[str]]:
    """Modules, data and pages that name each key."""
    places = [*(root / "backend" / "stridelab").rglob("*.py"), *(root / "models").rglob("*.toml")]
    places += (root / "docs").rglob("*.md")
    any_key = re.compile(rf"\b(?:{'|'.join(map(re.escape, entries(root)))})\b")
    cited: dict[str, list[str]] = {key: [] for key in entries(root)}
    for path in sorted(places):
        for key in dict.fromkeys(any_key.findall(path.read_text(encoding="utf-8"))):
            cited[key].append(str(path.relative_to(root)).removeprefix("backend/stridelab/"))
    return cited


def bibliography_page(root: Path) -> str:
    """All entries by key."""
    lines = ["# Literature", "", "From `models/references.bib`. Results and cards of robots name these keys.", ""]
    cited = citing_places(root)
    for key, fields in sorted(entries(root).items()):
        where = ", ".join(f"`{place}`" for place in cited[key])
        lines += [f"## {key}", "", written(fields), "", f"Cited by {where}.", ""]
    return "\n".join(lines)
