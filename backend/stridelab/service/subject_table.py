"""The subject table of a bulk upload or a folder: a CSV that assigns a subject to every file.

    file,subject,group,height_m,mass_kg,sex,age,static
    P01_walk_1.c3d,P01,adults,1.71,60.2,female,31,P01_static.c3d

Only ``file`` is required; columns may come in any order, with commas, semicolons or tabs between them.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.population import MAX_RECORDINGS, PersonFields

COLUMNS: Final[Mapping[str, str]] = {
    "file": "file",
    "subject": "subject",
    "group": "group",
    "height_m": "height_m",
    "mass_kg": "mass_kg",
    "sex": "sex",
    "age": "age_years",
    "age_years": "age_years",
    "static": "static",
}
SEX_ABBREVIATIONS: Final[Mapping[str, str]] = {"f": "female", "w": "female", "m": "male"}
MAX_TABLE_BYTES: Final = 1_000_000
_HINTS: Final[Mapping[str, str]] = {
    "height_m": "stature in metres, from 0.4 to 2.6 (171 cm is 1.71)",
    "mass_kg": "body mass in kilograms, from 2 to 400",
    "sex": "female or male, or left empty",
    "age_years": "age in years, from 0 to 120",
    "subject": "a pseudonym of at most 80 characters",
    "group": "a name of at most 80 characters",
}


@dataclass(frozen=True)
class TableRow:
    """One line: the recording file, the subject, and the file of the subject's static trial."""

    line: int
    file: str
    person: PersonFields
    static: str | None = None


@dataclass(frozen=True)
class MatchedFile:
    """A recording file: its index in the given names, its table row and the index of its static trial."""

    index: int
    row: TableRow | None
    static_index: int | None


def read_subject_table(content: bytes) -> tuple[TableRow, ...]:
    """The rows of a table.

    Raises ``InvalidInput`` (``subject-table-invalid``) naming every invalid line and column.
    """
    if len(content) > MAX_TABLE_BYTES:
        raise _invalid_table("The subject table is larger than 1 MB.", [Fault("subjects", "too large")])
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _invalid_table("The subject table is not UTF-8 text.", [Fault("subjects", "not UTF-8")]) from error
    if "\0" in text:
        raise _invalid_table("The subject table is not text.", [Fault("subjects", "contains NUL bytes")])
    head = text.partition("\n")[0]
    delimiter = max(",;\t", key=head.count)
    try:
        lines = list(csv.reader(io.StringIO(text), delimiter=delimiter, strict=True))
    except csv.Error as error:
        raise _invalid_table("The subject table is not valid CSV.", [Fault("subjects", str(error)[:200])]) from error
    columns = _parse_header(lines[0] if lines else [])
    rows: list[TableRow] = []
    faults: list[Fault] = []
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        row = _parse_row(number, columns, cells, faults)
        if row is not None:
            rows.append(row)
    seen: dict[str, int] = {}
    for row in rows:
        if row.file in seen:
            faults.append(Fault(f"line {row.line}, column file", f"{row.file} is already in line {seen[row.file]}"))
        seen.setdefault(row.file, row.line)
    if len(rows) > MAX_RECORDINGS:
        faults.append(Fault("subjects", f"{len(rows)} lines; at most {MAX_RECORDINGS}"))
    if faults:
        raise _invalid_table(f"The subject table is not valid: see {faults[0].where}.", faults[:50])
    return tuple(rows)


def match_files(names: Sequence[str], rows: Sequence[TableRow]) -> tuple[MatchedFile, ...]:
    """Match the rows of a subject table to files ``names`` (paths with /); returns the recordings among the files.

    A row names a file by its path or by its last part. Static trials named by a row are not recordings of their own.
    Raises ``InvalidInput`` (``subject-table-invalid``) for rows that match no file or several.
    """
    faults: list[Fault] = []

    def index_of(file: str, line: int, column: str) -> int | None:
        plain = file.replace("\\", "/").removeprefix("./")
        whole = [i for i, name in enumerate(names) if name == plain]
        matches = whole or [i for i, name in enumerate(names) if name.rpartition("/")[2] == plain]
        if len(matches) == 1:
            return matches[0]
        message = f"no file {file[:80]} was given" if not matches else f"{len(matches)} files are called {file[:80]}"
        faults.append(Fault(f"line {line}, column {column}", message))
        return None

    row_of: dict[int, TableRow] = {}
    statics: dict[int, int | None] = {}
    for row in rows:
        place = index_of(row.file, row.line, "file")
        static = None if row.static is None else index_of(row.static, row.line, "static")
        if place is not None:
            if place in row_of:
                faults.append(Fault(f"line {row.line}, column file", f"the same file as line {row_of[place].line}"))
            row_of[place], statics[place] = row, static
    if faults:
        raise _invalid_table(f"The subject table does not fit the files: see {faults[0].where}.", faults[:50])
    static_only = set(statics.values()) - set(row_of)
    return tuple(MatchedFile(i, row_of.get(i), statics.get(i)) for i in range(len(names)) if i not in static_only)


def _parse_header(head: Sequence[str]) -> list[str]:
    names = [cell.strip().lower() for cell in head]
    faults = [
        Fault(f"line 1, column {i}", f"unknown column {name[:40]!r}; there are {', '.join(COLUMNS)}")
        for i, name in enumerate(names, start=1)
        if name not in COLUMNS
    ]
    fields = [COLUMNS.get(name, "") for name in names]
    faults += [Fault("line 1", f"column {field} twice") for field in dict.fromkeys(fields) if fields.count(field) > 1]
    if "file" not in fields:
        faults.append(Fault("line 1", "there is no column file"))
    if faults:
        raise _invalid_table("The first line of the subject table must name its columns.", faults)
    return fields


def _parse_row(number: int, columns: Sequence[str], cells: Sequence[str], faults: list[Fault]) -> TableRow | None:
    if len(cells) != len(columns):
        faults.append(Fault(f"line {number}", f"{len(cells)} cells under {len(columns)} columns"))
        return None
    stated = {name: cell.strip() for name, cell in zip(columns, cells, strict=True) if cell.strip()}
    file, static = stated.pop("file", ""), stated.pop("static", None)
    if not file:
        faults.append(Fault(f"line {number}, column file", "empty"))
        return None
    sex = stated.get("sex", "").lower()
    if sex:
        stated["sex"] = SEX_ABBREVIATIONS.get(sex, sex)
    try:
        return TableRow(number, file, PersonFields.model_validate(stated), static)
    except ValidationError as error:
        for item in error.errors(include_url=False):
            field = str(item["loc"][0])
            column = "age" if field == "age_years" else field
            faults.append(Fault(f"line {number}, column {column}", _HINTS.get(field, item["msg"])))
        return None


def _invalid_table(message: str, faults: Sequence[Fault]) -> InvalidInput:
    return InvalidInput("subject-table-invalid", message, faults)
