"""The report on simulated walks: what it says, alike in HTML and PDF, and what it says where something is missing."""

import base64
import re
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from datetime import date
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from stridelab.errors import NotEstimable
from stridelab.pipelines.gait_measures.pooled import SEVERAL_PEOPLE, may_be_several_people, speed_remarks
from stridelab.pipelines.gait_report.content import Curve, Panel
from stridelab.pipelines.gait_report.drawing import Area, Line, Text, draw_panel
from stridelab.pipelines.gait_report.fonts import wrap_text
from stridelab.pipelines.gait_report.html import render_html
from stridelab.pipelines.gait_report.logo import Logo
from stridelab.pipelines.gait_report.paper import PAGE_HEIGHT, RIGHT_EDGE, Picture, lay_out
from stridelab.pipelines.gait_report.pdf import render_pdf
from stridelab.pipelines.gait_report.reasons import cautions_of, missing_measures
from stridelab.pipelines.gait_report.report import GaitReport, gait_report
from stridelab.pipelines.gait_report.texts import height_text
from stridelab.schemas.jobs import EstimateComInput, SimulateRecordingInput
from stridelab.schemas.measures import (
    MEASURE_TITLES,
    GaitReportInput,
    GaitReportSummary,
    GaitReportTask,
    MeasuresMember,
    ReferencePerson,
    ReferenceValue,
    measure_title,
)
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.tasks import EstimateComTask, RecordingSource, SimulateRecordingTask
from stridelab.service.kinds.simulate_recording import run as simulate_recording
from stridelab.translations.catalogue import in_language
from support.command_line import SAMPLE, RecordedProgress, quiet
from support.fakes import results

TRIAL = SAMPLE / "recording.c3d"
NO_PLATES = {index: PlateSwitch(use=False) for index in range(1, 30)}
HOSTILE = '<script>alert("x")</script> & Dvořák'


def member(folder: Path, file: Path = TRIAL, **source: Any) -> MeasuresMember:
    name = f"recording-{len(list(folder.glob('recording-*')))}"
    (folder / name).mkdir()
    shutil.copyfile(file, folder / name / "trial")
    recording = RecordingSource(**{"file": "trial", "filename": file.name, **source})
    task = EstimateComTask(recording=recording, input=EstimateComInput(recording_id=name))
    return MeasuresMember(recording_id=name, folder=name, task=task)


def task_of(*members: MeasuresMember, title: str | None = None, **fields_: Any) -> GaitReportTask:
    request = GaitReportInput(recording_ids=[one.recording_id for one in members], title=title)
    return GaitReportTask(members=list(members), input=request, created_on=date(2026, 5, 4), **fields_)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds over plates below every footprint: measures of energy and curves exist."""
    folder = tmp_path_factory.mktemp("walk")
    requested = SimulateRecordingInput(duration_s=8.0, seed=7, lab="walkway", speed_m_s=1.2)
    simulate_recording.run(SimulateRecordingTask(input=requested), folder, quiet)
    return (folder / "recording.c3d").rename(folder / "walk.c3d")


@pytest.fixture(scope="module")
def full(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> GaitReport:
    """With a reference group of two people, earlier recordings, and files that cannot be read."""
    folder = tmp_path_factory.mktemp("full")
    broken = folder / "broken.c3d"
    broken.write_bytes(b"no recording")
    people = [ReferencePerson(members=[member(folder, file)]) for file in (TRIAL, walk, broken)]
    before = [member(folder), member(folder, broken)]
    given = [member(folder, walk, filename=HOSTILE), member(folder, broken)]
    task = task_of(*given, title=HOSTILE, reference=people, before=before, lab_name="Lab <b>")
    return gait_report(task, folder, RecordedProgress())


@pytest.fixture(scope="module")
def markers_only(tmp_path_factory: pytest.TempPathFactory) -> GaitReport:
    folder = tmp_path_factory.mktemp("markers")
    return gait_report(task_of(member(folder, plates=NO_PLATES)), folder, quiet)


def texts_of(part: Any) -> Iterator[str]:
    """All texts of a structure, in their order."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, tuple | list):
        for one in part:
            yield from texts_of(one)
    elif isinstance(part, Logo | np.ndarray) or part is None:
        return
    elif is_dataclass(part):
        for field in fields(part):
            if field.name not in {"name", "label"}:
                yield from texts_of(getattr(part, field.name))


class TextParser(HTMLParser):
    """Collects the text outside of styles, and all elements and attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._style = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._style = tag == "style"

    def handle_endtag(self, tag: str) -> None:
        self._style = False

    def handle_data(self, data: str) -> None:
        if not self._style:
            self.texts.append(data)


def parsed(html: str) -> TextParser:
    parser = TextParser()
    parser.feed(html)
    return parser


def squeezed(text: str) -> str:
    """Without white space, and without what the encoding of a PDF font changes."""
    return re.sub(r"[^!-~]", "", text)


def pdf_text(content: bytes) -> str:
    """Texts of all pages; the codes of ASCII characters are these characters."""
    streams = re.findall(rb"/ASCII85Decode.*?stream\r?\n(.*?)~>", content, re.DOTALL)
    pages = [zlib.decompress(base64.a85decode(stream)) for stream in streams]
    strings = [match for page in pages if b"BT" in page for match in re.findall(rb"\(((?:\\.|[^\\)])*)\) Tj", page)]
    plain = [re.sub(rb"\\(\d{3}|.)", lambda m: b"" if m[1].isdigit() else m[1], one) for one in strings]
    return squeezed("".join(one.decode("latin-1") for one in plain))


def test_the_numbers_are_those_of_the_measures(full: GaitReport) -> None:
    tiles = {tile.name: tile for tile in full.content.tiles}
    by_side = {(one.name, one.side): one for one in full.summary.measures}
    speed, margin = by_side["walking_speed", None], by_side["margin_of_stability_ml_min", None]
    assert tiles["walking_speed"].value == f"{speed.mean:.2f} m/s"
    assert tiles["margin_of_stability_ml_min"].value == f"{1000 * margin.mean:.0f} mm"
    assert margin.ci95 is not None
    low, high = (1000 * edge for edge in margin.ci95)
    assert tiles["margin_of_stability_ml_min"].interval == f"95 %: {low:.0f} to {high:.0f}"
    left, right = (by_side["step_length", side].mean for side in ("left", "right"))
    assert tiles["step_length"].sides == f"left {left:.3f} · right {right:.3f}"
    assert tiles["step_length"].symmetry == f"symmetry {200 * (left - right) / (left + right):+z.1f} %"
    row = next(one for one in full.content.rows if one.name == "step_length")
    assert row.left is not None
    assert row.left.n == by_side["step_length", "left"].n
    assert set(dict(full.content.facts)) == {"Steps", "Recordings", "Body mass", "Height"}
    assert dict(full.content.facts)["Body mass"] == "60.0 ± 0.7 kg, from the file"


def test_the_curves_are_the_means_over_all_cycles(full: GaitReport) -> None:
    for panel in full.content.panels:
        assert [curve.label for curve in panel.curves] == ["left", "right"]
        assert panel.reference is not None
        assert panel.reference.n == 2, "people, not cycles"
    height = full.content.panels[0].curves[0]
    assert height.n >= 3
    assert 20.0 < np.ptp(height.mean) < 60.0, "millimetres"
    assert f"{height.n} left and" in full.content.panel_note


def test_people_are_the_units_of_the_reference_group(full: GaitReport) -> None:
    assert full.summary.reference_people == 2
    assert "fewer than 5 people mean nothing" in full.content.reference_note
    row = next(one for one in full.content.rows if one.name == "walking_speed")
    assert row.reference is not None
    assert row.reference.n == 2
    group = next(one for one in full.summary.reference if one.name == "walking_speed")
    assert group.z is not None
    assert row.z == f"{group.z:+z.1f}"


def test_files_that_cannot_be_read_are_listed_with_the_reason(full: GaitReport) -> None:
    assert [one.filename for one in full.summary.left_out] == ["broken.c3d"] * 3
    ((names, reason),) = full.content.left_out
    assert names == "broken.c3d, broken.c3d, broken.c3d"
    assert "no known format" in reason


def test_before_and_after_have_recordings_as_units(full: GaitReport) -> None:
    speed = next(one for one in full.summary.changes if one.name == "walking_speed")
    assert (speed.n_before, speed.n_after, speed.ci95) == (1, 1, None)
    assert speed.change == pytest.approx(speed.after - speed.before)
    assert "two recordings before and two after" in full.content.change_note


@pytest.mark.parametrize("report", ["full", "markers_only"])
def test_html_and_pdf_say_the_same(report: str, request: pytest.FixtureRequest) -> None:
    content = request.getfixturevalue(report).content
    page = squeezed("".join(parsed(render_html(content)).texts))
    paper = squeezed("".join(item.text for items in lay_out(content) for item in items if isinstance(item, Text)))
    document = pdf_text(render_pdf(content))
    texts = [squeezed(text) for text in texts_of(content) if squeezed(text)]
    assert len(texts) > 150
    for text in texts:
        assert text in page
        if len(text) < 30:  # longer ones continue on another line, in a table beside the next cell
            assert text in paper
            assert text in document


def test_every_text_is_escaped_and_nothing_is_loaded(full: GaitReport) -> None:
    html = render_html(full.content)
    page = parsed(html)
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    assert HOSTILE in page.texts
    tags = {tag for tag, _ in page.tags}
    assert not tags & {"script", "iframe", "object", "link", "form", "a"}
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") or name in {"href", "action"} for name in attributes), tag
    assert re.findall(r"https?://", html) == []


def test_names_of_people_appear_only_if_typed(walk: Path, tmp_path: Path) -> None:
    named = member(tmp_path, walk, subject=SubjectFields(name="Jane Doe"))
    report = gait_report(task_of(named), tmp_path, quiet)
    assert "Jane" not in render_html(report.content)
    assert report.content.title == "Gait report"


def test_the_pdf_is_the_same_every_time(full: GaitReport) -> None:
    content = render_pdf(full.content)
    assert content == render_pdf(full.content)
    assert content.startswith(b"%PDF-1.")
    assert b"Vera" in content, "the font is embedded"


def test_nothing_leaves_the_paper(full: GaitReport) -> None:
    pages = lay_out(full.content)
    assert 2 <= len(pages) <= 4
    for page in pages:
        for item in page:
            points = item.points if isinstance(item, Line | Area) else [(item.x, item.y)]
            assert all(10.0 <= x <= RIGHT_EDGE + 0.01 and 5.0 <= y <= PAGE_HEIGHT - 5.0 for x, y in points)
    numbers = [item.text for page in pages for item in page if getattr(item, "text", "").startswith("Page ")]
    assert numbers == [f"Page {k + 1} of {len(pages)}" for k in range(len(pages))]


def test_characters_that_the_font_lacks_are_owned_up_to(markers_only: GaitReport) -> None:
    texts = [
        item.text
        for page in lay_out(replace(markers_only.content, title="Ж 7"))
        for item in page
        if hasattr(item, "text")
    ]
    assert "? 7" in texts
    assert any("the HTML report has them" in text for text in texts)


def test_a_word_longer_than_a_line_is_divided() -> None:
    lines = wrap_text("x" * 400, 3.0, 50.0)
    assert "".join(lines) == "x" * 400
    assert len(lines) > 5


def test_without_plates_there_is_a_reason_and_never_a_zero(markers_only: GaitReport) -> None:
    content = markers_only.content
    assert any("markers alone" in text for text in content.cautions)
    missing = dict(content.missing)
    works = next(titles for titles in missing if "Positive work of the left leg" in titles)
    assert "No whole stance of this foot is measured on plates" in missing[works]
    assert not any("work of the leg" in row.title for row in content.rows)
    assert next(tile for tile in content.tiles if tile.name == "walking_speed").value != ""


def summary_with(**changes: Any) -> GaitReportSummary:
    return GaitReportSummary(**results.measures_summary().model_copy(update=changes).model_dump())


def test_a_missing_side_is_named_with_the_measures_that_lack_it() -> None:
    right = [one for one in results.measures_summary().measures if one.side != "left"]
    summary = summary_with(measures=right, sides={"left": 0, "right": 3}, steps=3)
    missing = {reason: titles for titles, reason in missing_measures(summary)}
    assert "Step length, left" in missing["No whole step of the left foot allows it."]
    assert "right" not in missing["No whole step of the left foot allows it."]
    assert cautions_of(summary) == ("No whole step of the left foot is measured.",)


def test_few_steps_and_another_speed_than_the_group_stand_before_the_numbers() -> None:
    group = ReferenceValue(name="walking_speed", unit="m/s", value=0.8, n_people=9, mean=1.3, between_sd=0.1, z=-5.0)
    summary = summary_with(steps=3, sides={"left": 2, "right": 1}).model_copy(update={"reference": [group]})
    few, speed = cautions_of(summary)
    assert few.startswith("Only 3 steps are measured")
    assert "z = -5.0" in speed


def test_every_measure_is_given_or_missing_with_a_reason() -> None:
    summary = summary_with()
    given = {one.name for one in summary.measures}
    titles = "; ".join(titles for titles, _ in missing_measures(summary))
    absent = [measure_title(name) for name in MEASURE_TITLES if name not in given]
    assert absent
    assert all(title in titles for title in absent)
    reasons = dict(missing_measures(summary))
    assert "One plate." in reasons.values()


def test_recordings_of_several_speeds_are_remarked_on_as_mixed(full: GaitReport) -> None:
    slow = full.measured.recordings[0]
    halved = [replace(one, value=0.5 * one.value) if one.name == "walking_speed" else one for one in slow.measures]
    (mixed,) = speed_remarks([slow, replace(slow, measures=tuple(halved))])
    assert mixed.code == "speeds-mixed"
    remarked = full.summary.model_copy(update={"warnings": [mixed]})
    for language, text in (("en", "report the conditions one by one"), ("de", "von der Geschwindigkeit ab")):
        with in_language(language):
            assert any(text in caution for caution in cautions_of(remarked))
    assert speed_remarks([slow, slow]) == ()
    assert not any("conditions" in text for text in cautions_of(full.summary))


def test_recordings_of_several_people_are_remarked_on_and_have_their_range(full: GaitReport) -> None:
    """Means over people of different height say nothing about either, and no single height is theirs."""
    one = full.measured.recordings[0]
    height_m = one.motion.stature_m
    assert height_m is not None
    taller = replace(one, motion=replace(one.motion, stature_m=height_m + 0.15))
    heavy = replace(one.prepared.mass, mass_kg=1.2 * one.prepared.mass.mass_kg)
    heavier = replace(one, prepared=replace(one.prepared, mass=heavy))
    assert not may_be_several_people([one, one])
    assert may_be_several_people([one, taller])
    assert may_be_several_people([one, heavier])
    remarked = full.summary.model_copy(update={"warnings": [SEVERAL_PEOPLE]})
    cautions = cautions_of(remarked)
    assert any("report people one by one" in text for text in cautions)
    assert not any("people" in text for text in full.content.cautions)
    assert height_text([one, taller]) == f"{height_m:.2f} to {height_m + 0.15:.2f} m"
    assert height_text([one, one]) == f"{height_m:.2f} m"


def test_without_any_measured_recording_there_is_no_report(tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording")
    with pytest.raises(NotEstimable) as refused:
        gait_report(task_of(member(tmp_path, broken), member(tmp_path, broken)), tmp_path, quiet)
    assert refused.value.code == "nothing-measured"


def test_an_unusable_logo_is_a_remark_and_a_png_is_on_the_first_page(tmp_path: Path) -> None:
    one = member(tmp_path)
    (tmp_path / "lab-logo").write_bytes(b"no picture")
    report = gait_report(task_of(one, logo="lab-logo"), tmp_path, quiet)
    assert "logo-not-used" in {remark.code for remark in report.summary.warnings}
    assert report.content.logo is None
    Image.new("RGBA", (40, 10), "navy").save(tmp_path / "lab-logo", "PNG")
    report = gait_report(task_of(one, logo="lab-logo"), tmp_path, quiet)
    pictures = [item for item in lay_out(report.content)[0] if isinstance(item, Picture)]
    assert [picture.width / picture.height for picture in pictures] == [pytest.approx(4.0)]
    assert b"/Image" in render_pdf(report.content)
    images = [attributes["src"] for tag, attributes in parsed(render_html(report.content)).tags if tag == "img"]
    assert [str(src)[:22] for src in images] == ["data:image/png;base64,"]


def test_a_chart_without_curves_says_so_and_gaps_are_no_lines() -> None:
    empty = Panel("com_vertical", "Height", "mm", (), None)
    assert any(getattr(item, "text", "") == "not measured" for item in draw_panel(empty).items)
    mean = np.linspace(0.0, 10.0, 101)
    mean[40:60] = np.nan
    drawing = draw_panel(Panel("com_vertical", "Height", "mm", (Curve("left", 1, mean, None),), None))
    curves = [item for item in drawing.items if isinstance(item, Line) and item.width == 0.5]
    assert [len(one.points) for one in curves] == [40, 41]
    assert not any(isinstance(item, Area) for item in drawing.items), "one cycle has no band"
