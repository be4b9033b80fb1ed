"""The subject table: every way of writing it that a spreadsheet has, and each fault by its line and column."""

import pytest

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.population import MAX_RECORDINGS, PersonFields
from stridelab.service.subject_table import MAX_TABLE_BYTES, TableRow, match_files, read_subject_table


def faults(content: bytes) -> tuple[Fault, ...]:
    with pytest.raises(InvalidInput) as refused:
        read_subject_table(content)
    assert refused.value.code == "subject-table-invalid"
    assert refused.value.message
    return tuple(refused.value.faults)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_delimiters_byte_order_mark_and_line_ends(delimiter: str, start: bytes, end: str) -> None:
    lines = [
        ["age", "File", "subject", "group", "height_m", "sex", "static"],
        ["31", "a.c3d", "P01", "adults", "1.71", "F", "standing.c3d"],
        [""] * 7,
        ["", " b.c3d ", "", "", "", "", ""],
    ]
    text = end.join(delimiter.join(cells) for cells in lines)
    first, second = read_subject_table(start + text.encode())
    person = PersonFields(subject="P01", group="adults", height_m=1.71, sex="female", age_years=31)
    assert first == TableRow(2, "a.c3d", person, "standing.c3d")
    assert second == TableRow(4, "b.c3d", PersonFields())


def test_a_quoted_delimiter_belongs_to_the_cell() -> None:
    (row,) = read_subject_table(b'file,group\n"walk, fast.c3d","a,b"\n')
    assert (row.file, row.person.group) == ("walk, fast.c3d", "a,b")


def test_only_the_names_of_the_columns_are_no_rows() -> None:
    assert read_subject_table(b"file,subject\n") == ()


@pytest.mark.parametrize(
    ("column", "cell", "says"),
    [
        ("height_m", "171", "1.71"),
        ("height_m", "1,71", "1.71"),
        ("height_m", "nan", "1.71"),
        ("mass_kg", "heavy", "kilograms"),
        ("age", "-1", "years"),
        ("sex", "x", "female or male"),
        ("subject", "P" * 81, "80 characters"),
        ("group", "a\x07b", "80 characters"),
    ],
)
def test_a_cell_is_named_by_line_and_column(column: str, cell: str, says: str) -> None:
    (fault,) = faults(f"file;{column}\na.c3d;\nb.c3d;{cell}\n".encode())
    assert fault.where == f"line 3, column {column}"
    assert says in fault.message


def test_all_faults_are_named_at_once() -> None:
    table = b"file,height_m,age\na.c3d,171,200\n,1.7,30\nc.c3d,1.7\nd.c3d,1.7,30\nd.c3d,1.8,30\n"
    assert [fault.where for fault in faults(table)] == [
        "line 2, column height_m",
        "line 2, column age",
        "line 3, column file",
        "line 4",
        "line 6, column file",
    ]


@pytest.mark.parametrize(
    ("content", "where", "says"),
    [
        (b"", "line 1", "no column file"),
        (b"\xef\xbb\xbf", "line 1", "no column file"),
        (b"subject\nP01\n", "line 1", "no column file"),
        (b"file,shoe\na.c3d,42\n", "line 1, column 2", "'shoe'"),
        (b"file,age,age_years\na.c3d,1,1\n", "line 1", "age_years twice"),
        ("file,subject\na.c3d,Zo\u00eb\n".encode("latin-1"), "subjects", "not UTF-8"),
        (b"file\na\0b\n", "subjects", "NUL bytes"),
        (b'file\n"a.c3d\n', "subjects", "unexpected end"),
        (b"file\n" + b"a" * MAX_TABLE_BYTES, "subjects", "too large"),
    ],
)
def test_what_is_no_table_of_subjects(content: bytes, where: str, says: str) -> None:
    (fault,) = faults(content)
    assert fault.where == where
    assert says in fault.message


def test_as_many_rows_as_recordings_and_no_more() -> None:
    lines = [f"walk-{n}.c3d\n" for n in range(MAX_RECORDINGS + 1)]
    assert len(read_subject_table(("file\n" + "".join(lines[:-1])).encode())) == MAX_RECORDINGS
    (fault,) = faults(("file\n" + "".join(lines)).encode())
    assert fault == Fault("subjects", f"{MAX_RECORDINGS + 1} lines; at most {MAX_RECORDINGS}")


def test_many_faults_are_cut_to_the_first_fifty() -> None:
    listed = faults(b"file,height_m\n" + b"".join(b"walk-%d.c3d,171\n" % n for n in range(60)))
    assert len(listed) == 50
    assert listed[-1].where == "line 51, column height_m"


def test_rows_find_their_files_by_path_or_last_part_and_static_trials_are_no_walks() -> None:
    names = ["day-1/a.c3d", "day-2/a.c3d", "b.c3d", "standing.c3d", "c.c3d"]
    rows = read_subject_table(
        b"file,subject,static\n.\\day-1\\a.c3d,P01,standing.c3d\nday-2/a.c3d,P01,standing.c3d\nb.c3d,P02,\n"
    )
    matches = match_files(names, rows)
    assert [(one.index, one.static_index) for one in matches] == [(0, 3), (1, 3), (2, None), (4, None)]
    assert [one.row.line if one.row else None for one in matches] == [2, 3, 4, None]


@pytest.mark.parametrize(
    ("table", "where", "says"),
    [
        (b"file\nz.c3d\n", "line 2, column file", "no file z.c3d"),
        (b"file\na.c3d\n", "line 2, column file", "2 files are called a.c3d"),
        (b"file,static\nb.c3d,z.c3d\n", "line 2, column static", "no file z.c3d"),
        (b"file\nb.c3d\n./b.c3d\n", "line 3, column file", "the same file as line 2"),
    ],
)
def test_rows_that_fit_no_file_or_several(table: bytes, where: str, says: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        match_files(["day-1/a.c3d", "day-2/a.c3d", "b.c3d"], read_subject_table(table))
    assert refused.value.code == "subject-table-invalid"
    (fault,) = refused.value.faults
    assert fault.where == where
    assert says in fault.message
