"""The report in every language: no text stays English, and the Japanese PDF has its font and its line breaks."""

import re
from pathlib import Path
from typing import get_args

import pytest

import stridelab as sl
from stridelab.pipelines.gait_measures.pooled import GaitMeasuresResult, gait_measures
from stridelab.pipelines.gait_report import report
from stridelab.pipelines.gait_report.drawing import Text
from stridelab.pipelines.gait_report.fonts import JAPANESE, REPLACEMENT, replace_missing_glyphs, wrap_text
from stridelab.pipelines.gait_report.paper import lay_out
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.measures import GaitMeasuresTask
from stridelab.schemas.service import Language
from stridelab.translations.catalogue import current_language, in_language
from support.command_line import SAMPLE

TRIAL = SAMPLE / "recording.c3d"
SAME_WORDS = {"Version", "Cadence", "position"}
"""Texts that two languages have alike."""


def drawn_texts(written: sl.GaitReport) -> set[str]:
    content = written.report.content
    with in_language(content.language):
        return {item.text for page in lay_out(content) for item in page if isinstance(item, Text)}


def test_a_report_is_written_in_its_language(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the languages have alike are no words but names: files, methods, tables, literature.

    The same recordings are measured once for all reports, but anew in a language in which they were not.
    """
    results: dict[tuple[Language, str], GaitMeasuresResult] = {}

    def measure_once(task: GaitMeasuresTask, folder: Path, progress: ProgressCallback) -> GaitMeasuresResult:
        key = current_language(), task.model_dump_json()
        if key not in results:
            results[key] = gait_measures(task, folder, progress)
        return results[key]

    monkeypatch.setattr(report, "gait_measures", measure_once)
    (tmp_path / "people").mkdir()
    earlier, other = tmp_path / "earlier.c3d", tmp_path / "people/other.c3d"
    for number, path in enumerate((earlier, other), start=1):  # not the same file: bytes follow its end
        path.write_bytes(TRIAL.read_bytes() + bytes(512 * number))
    reports = {
        language: sl.gait_report(TRIAL, before=earlier, reference=tmp_path / "people", language=language)
        for language in get_args(Language)
    }
    texts = {language: drawn_texts(one) for language, one in reports.items()}
    assert all(len(said) > 100 for said in texts.values())
    content = reports["en"].report.content
    names = " ".join([*content.references, *(one.filename for one in content.trials), "smoother rad/s"])
    for language in ("de", "fr", "ja"):
        alike = texts["en"] & texts[language]
        words = {text for text in alike if re.search("[A-Za-z]{3}", text.replace("/min", "")) and text not in names}
        assert {text for text in words if not text.startswith("stridelab ")} <= SAME_WORDS, language
        page = reports[language].html
        assert f'<html lang="{language}">' in page
        assert "Margin of stability" not in page
        assert reports[language].pdf == reports[language].pdf
    assert reports["ja"].summary == reports["en"].summary, "fields of the interface stay English"


def test_a_japanese_report_names_a_font_of_pdf_and_embeds_none() -> None:
    """Adobe-Japan1 is the collection of characters that readers draw with a Japanese font of the system."""
    written = sl.gait_report(TRIAL, title="歩行レポート 山田太郎", language="ja").pdf
    assert f"/BaseFont /{JAPANESE}".encode() in written
    assert b"/UniJIS-UCS2-H" in written
    assert b"/FontFile" not in written
    with in_language("ja"):
        assert replace_missing_glyphs("山田太郎、佐藤花子, 1.25 ± 0.03 m/s²") == "山田太郎、佐藤花子, 1.25 ± 0.03 m/s²"
        assert replace_missing_glyphs("\U00020b9f") == REPLACEMENT


def test_japanese_lines_break_between_characters_and_not_before_punctuation() -> None:
    text = "測定できたのは四歩だけです。左右対称性と歩ごとのばらつきは不確かです。" * 3
    with in_language("ja"):
        lines = wrap_text(text, 2.4, 40.0)
    assert "".join(lines) == text
    assert len(lines) > 5
    assert not any(line[0] in "、。" for line in lines)
