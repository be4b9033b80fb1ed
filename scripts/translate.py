"""Updates the catalogues of translations (backend/stridelab/translations/*.po) from pages, scripts and reports.

    scripts/translate            new messages are added without a translation, those that are no longer used are removed
    scripts/translate --check    changes nothing; exits with 1 if a catalogue is not complete and up to date

Messages are ``_("...")`` and ``{% trans %}`` in templates, ``gettext("...")`` in Python, ``translate("...")`` and
``translateCount`` in JavaScript, and the values of the tables below.
"""

import argparse
import io
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from babel.messages.catalog import Catalog, Message
from babel.messages.extract import extract_from_dir
from babel.messages.pofile import read_po, write_po

from stridelab.pipelines.gait_report import reasons, texts
from stridelab.schemas.measures import MEASURE_TITLES
from stridelab.translations import catalogue, served_sentences, walk_sentences
from stridelab_web import formatting
from stridelab_web.charts import plotly
from stridelab_web.pages import errors, recording, render
from stridelab_web.pages.results import (
    com_bench,
    com_plots,
    comparison,
    comparison_plots,
    cycloid,
    cycloid_steps,
    measures,
    population,
    population_bars,
    population_charts,
    population_tables,
    quality,
    summary_facts,
)
from stridelab_web.pages.terms.results import ESTIMATE_TERMS
from stridelab_web.pages.viewer import page as viewer
from stridelab_web.scene import frames

ROOT = Path(__file__).resolve().parents[1]
WEB = ROOT / "frontend/stridelab_web"
TRANSLATED = sorted(code for code in catalogue.LANGUAGES if code != catalogue.ENGLISH)
REPORT = ROOT / "backend/stridelab/pipelines/gait_report"
METHODS = [
    ("templates/**.html", "jinja2"),
    ("**.j2", "jinja2"),
    ("static/js/**.js", "javascript"),
    ("**.py", "python"),
]
OPTIONS = {"templates/**.html": {"trimmed": "true", "silent": "false"}}
KEYWORDS = {
    "_": None,
    "gettext": None,
    "ngettext": (1, 2),
    "translate": None,
    "translateCount": (1, 2),
}
SCRIPT = "static/js/shared/api.js"
CALL = re.compile(r'\btranslate\(\s*"([^"\\]+)"')
"""A translated text in JavaScript; Babel does not see those within ``${...}`` and other calls."""
PLACES = re.compile(r"%\((\w+)\)[sd]")
TAGS = re.compile(r"</?[a-z][^>]*>|&\w+;")


def make_template() -> Catalog:
    """All messages of the pages with the files that contain them."""
    template = Catalog(charset="utf-8", project="stridelab", fuzzy=False)
    for folder, prefix in ((WEB, ""), (REPORT, "gait_report/")):
        for path, _, message, _, _ in extract_from_dir(folder, METHODS, OPTIONS, KEYWORDS):
            template.add(message, locations=[(f"{prefix}{path}", 0)])
    for script in sorted((WEB / "static/js").rglob("*.js")):
        for text in CALL.findall(script.read_text(encoding="utf-8")):
            if template.get(text) is None:
                raise ValueError(f"{script.name}: not extracted, because it is within another call or string: {text}")
    for place, listed in message_tables():
        for text in listed:
            template.add(text, locations=[(place, 0)])
    return template


def message_tables() -> Iterator[tuple[str, Iterable[str]]]:
    """Texts in tables, which are translated where they are shown, by the file that shows them."""
    layers = [*viewer.RECORDING_LAYERS, *viewer.COM_LAYERS, *viewer.WHEEL_LAYERS, *viewer.STABILITY_LAYERS]
    layers.append(viewer.SECOND_WALK_LAYER)
    readings = [one.name for one in com_plots.READINGS] + [one.name for one in com_plots.SWITCHES]
    yield "pages/render.py", [name for name, _ in render.NAVIGATION]
    yield "formatting.py", [*formatting.KINDS.values(), *formatting.METHODS.values()]
    yield SCRIPT, formatting.STATES
    yield SCRIPT, [*served_sentences.SCRIPTED, *served_sentences.CHECKS]
    yield "served_sentences.py", served_sentences.ON_PAGES
    yield "walk_sentences.py", walk_sentences.LEFT_OUT
    yield "pages/errors.py", [*errors.TITLES.values(), *errors.EXPLANATIONS.values()]
    yield "pages/recording.py", [text for _, text in (*recording.LATENCIES, *recording.TABLES)]
    yield "pages/results/quality.py", [*quality.NAMES.values(), *quality.TITLES.values(), *quality.VERDICTS]
    yield "pages/results/measures.py", [*MEASURE_TITLES.values(), *measures.MAIN.values(), measures.NO_MEANING]
    yield "pages/results/summary_facts.py", [*summary_facts.NAMES.values(), *summary_facts.VALUES]
    yield "pages/terms/results.py", [one.meaning for one in ESTIMATE_TERMS.values()]
    yield "pages/results/com_plots.py", [row.title for row in com_plots.ROWS]
    yield "pages/results/com_plots.py", [trace.name for row in com_plots.ROWS for trace in row.traces] + readings
    figures = comparison_plots.FIGURES.values()
    yield "pages/results/comparison.py", comparison.COLUMN_TITLES
    yield (
        "pages/results/comparison_plots.py",
        [text for one in figures for text in (one.title, one.description, one.hint)],
    )
    yield "pages/results/comparison_plots.py", [*(name for name, _ in comparison_plots.INPUTS.values()), "sum"]
    yield "pages/results/comparison_plots.py", [comparison_plots.FREQUENCY.title, "Gain [dB]", "Phase [rad]"]
    yield "pages/results/cycloid.py", [*cycloid.SOURCES.values(), "Start", "End"]
    yield "pages/results/cycloid_steps.py", [*(one.meaning for one in cycloid_steps.PARAMETERS), "left", "right"]
    yield "pages/results/cycloid_steps.py", [*cycloid_steps.MODELS.values(), *cycloid_steps.FLAGS.values()]
    yield "pages/results/cycloid_steps.py", [text for texts in cycloid_steps.SPACES.values() for text in texts]
    report_sides = [reasons.NO_STEP, reasons.STEP_NOT_ALLOWING, reasons.WHOLE_STEP_NOT_ALLOWING]
    yield "gait_report/reasons.py", [text for sides in report_sides for text in sides.values()]
    yield "gait_report/texts.py", [*texts.TILES.values(), *(text for pair in texts.PANELS.values() for text in pair)]
    yield "gait_report/texts.py", [*texts.MASS_SOURCES.values(), "Positive work of the leg", "Negative work of the leg"]
    yield "gait_report/drawing.py", ["left", "right", "reference"]
    quantities = population_charts.AGAINST
    yield "pages/results/population_charts.py", [text for one in quantities for text in (one.name, one.against)]
    yield "pages/results/population_bars.py", [text for texts in population_bars.TITLES.values() for text in texts]
    yield "pages/results/population_tables.py", population_tables.QUANTITY_NAMES.values()
    yield "templates/pages/population.html", [stem.capitalize() for stem in population.TABLES]
    yield "pages/results/com_bench.py", [*com_bench.MOVEMENT_TITLES.values(), *com_bench.SCORE_TITLES.values()]
    yield "charts/plotly.py", [plotly.TIME.title]
    yield "pages/viewer/page.py", [text for layer in layers for text in (layer.label, layer.tooltip) if text]
    yield "templates/partials/_subject.html", ["female", "male"]
    yield "static/js/viewer/hover_names.js", frames.LABELS


def read_catalogue(language: str) -> Catalog:
    """The stored catalogue; an empty one for a new language."""
    path = catalogue.FOLDER / f"{language}.po"
    if not path.exists():
        return Catalog(locale=language, charset="utf-8", project="stridelab", fuzzy=False)
    with path.open("rb") as file:
        return read_po(file, locale=language)


def updated_catalogue(language: str, template: Catalog) -> Catalog:
    """The stored translations of the messages of ``template``, in alphabetical order."""
    stored = read_catalogue(language)
    fresh = Catalog(locale=language, charset="utf-8", project="stridelab", fuzzy=False)
    for message in sorted((one for one in template if one.id), key=lambda one: str(one.id)):
        known = stored.get(message.id)
        locations = sorted({(path, 0) for path, _ in message.locations})
        fresh.add(message.id, known.string if known is not None else "", locations=locations)
    return fresh


def catalogue_text(catalogue: Catalog) -> bytes:
    """The text of a catalogue; places without line numbers, so that it changes only with the messages."""
    for message in catalogue:
        message.flags.discard("fuzzy")
        message.flags.discard("python-format")
    written = io.BytesIO()
    write_po(written, catalogue, width=110, include_lineno=False, omit_header=True)
    return HEADER.format(language=catalogue.locale, plural=catalogue.plural_forms).encode() + written.getvalue()


HEADER = """# Translations of stridelab's pages; scripts/translate updates the list of messages.
msgid ""
msgstr ""
"Language: {language}\\n"
"MIME-Version: 1.0\\n"
"Content-Type: text/plain; charset=utf-8\\n"
"Content-Transfer-Encoding: 8bit\\n"
"Plural-Forms: {plural}\\n"

"""


def faults_of(language: str, template: Catalog) -> list[str]:
    """What is wrong with a stored catalogue: missing, stale or incomplete messages, wrong placeholders or tags."""
    stored = read_catalogue(language)
    wanted = {message.id for message in template if message.id}
    faults = [f"{language}: stale: {message.id}" for message in stored if message.id and message.id not in wanted]
    for identity in sorted(wanted, key=str):
        message = stored.get(identity)
        if message is None:
            faults.append(f"{language}: missing: {identity}")
        else:
            faults += [f"{language}: {fault}: {identity}" for fault in _faults_of_message(message, stored.num_plurals)]
    return faults


def _faults_of_message(message: Message, n_forms: int) -> list[str]:
    originals = [message.id] if isinstance(message.id, str) else list(message.id)
    forms = [message.string] if isinstance(message.string, str) else list(message.string)
    if not all(forms) or (len(originals) > 1 and len(forms) != n_forms):
        return ["not translated"]
    faults = []
    for form in forms:
        if sorted(PLACES.findall(form)) not in [sorted(PLACES.findall(one)) for one in originals]:
            faults.append("other placeholders")
        if sorted(TAGS.findall(form)) not in [sorted(TAGS.findall(one)) for one in originals]:
            faults.append("other tags")
        if PLACES.sub("", form).count("%") != PLACES.sub("", originals[-1]).count("%"):
            faults.append("other percent signs")
        if any(sign in form for sign in '"<' if sign not in "".join(originals)):
            faults.append("a sign that closes an attribute")
    return faults


def _is_translated(message: Message) -> bool:
    return all([message.string] if isinstance(message.string, str) else message.string)


def main() -> None:
    """Update the catalogues, or check them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if one is not complete")
    template = make_template()
    if parser.parse_args().check:
        faults = [fault for language in TRANSLATED for fault in faults_of(language, template)]
        sys.exit("\n".join(faults) if faults else 0)
    catalogue.FOLDER.mkdir(exist_ok=True)
    for language in TRANSLATED:
        updated = updated_catalogue(language, template)
        (catalogue.FOLDER / f"{language}.po").write_bytes(catalogue_text(updated))
        missing = sum(not _is_translated(one) for one in updated if one.id)
        sys.stdout.write(f"{language}: {len(updated)} messages, {missing} without a translation\n")


if __name__ == "__main__":
    main()
