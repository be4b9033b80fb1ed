"""The languages of the pages: complete catalogues, and the language of a request."""

import re
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
import pytest
from babel.messages.catalog import Catalog

import translate
from stridelab.estimation import observability
from stridelab.estimation.latency import AxisLag, Latency
from stridelab.pipelines.gait_measures.pooled import SEVERAL_PEOPLE
from stridelab.pipelines.gait_report.texts import _check_text
from stridelab.pipelines.mass_and_latency import LatencyChoice, _applied_remark, _describe_choice, body_mass
from stridelab.recordings.body_mass import MassEstimate
from stridelab.recordings.gap_filling import bridge_force_gaps
from stridelab.recordings.marker_sets import all_substitutes
from stridelab.schemas.quality import Quality
from stridelab.schemas.sessions import SessionValues
from stridelab.service.jobs.progress_words import STAGE_WORDS, progress_words
from stridelab.translations import catalogue, served_sentences
from stridelab.translations.catalogue import LANGUAGES, gettext, in_language, ngettext
from stridelab_web import languages
from stridelab_web.formatting import served_text
from stridelab_web.languages import chosen_language
from stridelab_web.pages.results.quality import NAMES, shown_quality
from support.fakes.service import FakeService
from support.fakes.web_app import make_client

ROOT = Path(__file__).parents[2]
Browse = Callable[..., httpx.Response]
HEADINGS = {
    "en": "Where is the centre of mass?",
    "de": "Wo ist der Körperschwerpunkt?",
    "fr": "Où est le centre de masse ?",
    "ja": "重心はどこにある？",
}


@pytest.fixture(scope="module")
def template() -> Catalog:
    """All messages of the pages and scripts."""
    made: Catalog = translate.make_template()
    return made


@pytest.mark.parametrize("language", [code for code in LANGUAGES if code != "en"])
def test_catalogue_has_every_message_and_no_other(template: Catalog, language: str) -> None:
    assert len([message for message in template if message.id]) > 800
    assert translate.faults_of(language, template) == []


def test_catalogue_file_is_what_the_script_writes(template: Catalog) -> None:
    written = translate.catalogue_text(translate.updated_catalogue("fr", template))
    assert written == (catalogue.FOLDER / "fr.po").read_bytes()


@pytest.mark.parametrize(
    ("translation", "fault"),
    [
        ("", "not translated"),
        ("<b>%(one)s</b> %%", "other placeholders"),
        ("%(name)s %%", "other tags"),
        ("<b>%(name)s</b>", "other percent signs"),
        ('<b>%(name)s</b> %% "', "a sign that closes an attribute"),
    ],
)
def test_wrong_translations_are_reported(monkeypatch: pytest.MonkeyPatch, translation: str, fault: str) -> None:
    wanted, stored = Catalog(locale="de"), Catalog(locale="de")
    wanted.add("<b>%(name)s</b> has 5 %%")
    wanted.add("new")
    stored.add("<b>%(name)s</b> has 5 %%", translation)
    stored.add("old", "alt")
    monkeypatch.setattr(translate, "read_catalogue", lambda language: stored)
    assert translate.faults_of("de", wanted) == [
        "de: stale: old",
        f"de: {fault}: <b>%(name)s</b> has 5 %%",
        "de: missing: new",
    ]


def test_service_still_says_the_translated_sentences() -> None:
    files = [path for path in (ROOT / "backend/stridelab").rglob("*.py") if path.parent != catalogue.FOLDER]
    files.append(ROOT / "models/marker_sets/substitutes.toml")
    sources = "\n".join(path.read_text() for path in files)
    joined = re.sub(r'"\s*\n\s*f?"', "", sources)
    explained = served_sentences.OBSERVABILITY[:2]  # the service puts them together; so does the test below
    for sentence in set(served_sentences.SERVED) - set(explained):
        for part in re.split(r"%\(\w+\)s|; |: |, or |(?<=\.) | \(", sentence):
            assert part.strip(" .)") in joined, sentence


def test_sentence_on_what_the_force_cannot_show_is_translated() -> None:
    up = np.array([[0.0, 0.0, 1.0]])
    track = observability.ObservabilityTrack(np.array([5]), np.array([11]), up, np.array([False]))
    for tilt_rad in (0.0, 0.1):
        sentence = observability._explain_ranks(track, up[0], tilt_rad, 0.0)
        with in_language("de"):
            assert str(served_text(sentence)).startswith("Die Kraft bestimmt 5 von 9 Größen"), sentence


def test_checks_are_those_of_the_pages() -> None:
    assert [name.replace("_", " ") for name in NAMES] == list(served_sentences.CHECKS)


def test_browser_chooses_the_language(browse: Browse) -> None:
    for language, heading in HEADINGS.items():
        page = browse("/", headers={"Accept-Language": f"xx,{language};q=0.9,en;q=0.5"})
        assert f'<html lang="{language}">' in page.text
        assert heading in page.text
        assert {name.strip() for name in page.headers["vary"].split(",")} >= {"Accept-Language", "Cookie"}
        assert (f"/static/languages/{language}-" in page.text) == (language != "en")
    assert '<html lang="en">' in browse("/").text


def test_cookie_outranks_the_browser(browse: Browse) -> None:
    page = browse("/jobs", headers={"Accept-Language": "de", "Cookie": f"{languages.COOKIE}=fr"})
    assert '<html lang="fr">' in page.text


@pytest.mark.parametrize("cookie", ["xx", "../de", "de\r\nSet-Cookie: a=b", '"><script>', "DE"])
def test_other_cookies_are_ignored(cookie: str) -> None:
    assert chosen_language(cookie, "", None) == "en"


@pytest.mark.parametrize(
    ("header", "language"),
    [
        ("de-AT,fr;q=0.9", "de"),
        ("fr;q=0.3,ja;q=0.8", "ja"),
        ("zh,es;q=0.9", "en"),
        ("de;q=0,fr;q=0.1", "fr"),
        ("de;q=many, FR", "fr"),
        ("en,de;q=0.9", "en"),
        ("," * 5000 + "de", "en"),
    ],
)
def test_best_accepted_language(header: str, language: str) -> None:
    assert chosen_language(None, header, None) == language


def test_operator_setting_outranks_the_browser(fake: FakeService) -> None:
    client = make_client(fake, language="ja")
    assert '<html lang="ja">' in client.get("/", headers={"Accept-Language": "de"}).text
    chosen = {"Cookie": f"{languages.COOKIE}=en"}
    assert '<html lang="en">' in client.get("/", headers=chosen).text


def test_menu_stores_the_choice_and_returns_to_the_page(browse: Browse) -> None:
    assert 'href="?search=a+b&amp;language=de"' in browse("/recordings?search=a%20b&language=xx").text
    answer = browse("/recordings?search=a%20b&language=de")
    assert answer.status_code == 303
    assert answer.headers["location"] == "/recordings?search=a+b"
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{languages.COOKIE}=de;")
    assert "HttpOnly" in cookie
    assert "samesite=lax" in cookie.lower()


@pytest.mark.parametrize("address", ["//evil.example/?language=de", "/recordings?language=%0d%0aX:1"])
def test_menu_leads_nowhere_else(browse: Browse, address: str) -> None:
    answer = browse(f"http://127.0.0.1{address}")
    assert answer.status_code in (200, 404)
    assert "set-cookie" not in answer.headers


def test_page_without_translation_is_english_as_a_whole(browse: Browse) -> None:
    page = browse("/robots", headers={"Accept-Language": "de"}).text
    assert '<html lang="en">' in page
    assert "/static/languages/" not in page
    assert '<span class="hint" lang="de">Diese Seite gibt es nur auf Englisch.</span>' in page
    assert ">Recordings</a>" in page


def test_errors_are_explained_in_the_language(browse: Browse) -> None:
    page = browse("/jobs/unknown", headers={"Accept-Language": "de"})
    assert page.status_code == 404
    assert "<h1>Nicht gefunden</h1>" in page.text
    assert "Diesen Auftrag gibt es nicht, oder er wurde gelöscht." in page.text
    assert '<span lang="en">' in page.text


def test_script_messages_are_served_under_their_hash(browse: Browse) -> None:
    script, name = languages.script_catalogue("de")
    answer = browse(f"/static/languages/{name}")
    assert answer.text == script
    assert "immutable" in answer.headers["cache-control"]
    assert '"Choose recordings first.":"Bitte zuerst Aufnahmen auswählen."' in script
    assert "Wo ist der" not in script
    for wrong in ("de-000000000000.js", "xx-1.js", "..%2fde.po"):
        assert browse(f"/static/languages/{wrong}").status_code == 404


def test_numbers_have_plural_forms_and_a_decimal_point() -> None:
    for language, one, two in (("de", "1 Schritt", "2 Schritte"), ("fr", "1 pas", "2 pas"), ("ja", "1 歩", "2 歩")):
        with in_language(language):
            assert [ngettext("%(num)s step", "%(num)s steps", n) for n in (1, 2)] == [one, two]
            assert "1.25 s" in gettext("%(start)s s to %(end)s s", start="1.25", end="2.50")
    with in_language("fr"):
        assert ngettext("%(num)s file", "%(num)s files", 0) == "0 fichier"


def test_sentences_of_the_service_are_translated_or_marked() -> None:
    assert served_text("a <b>") == "a <b>"
    with in_language("de"):
        assert served_text("Doubtful: force residual") == "Zweifelhaft: Kraftresiduum"
        assert served_text("Doubtful: channel gain, force tilt and 3 more").endswith("Neigung der Kraft und 3 weitere")
        assert served_text("a <b>") == '<span lang="en">a &lt;b&gt;</span>'
        assert served_text("") == ""


def test_remarks_on_people_and_gaps_are_translated() -> None:
    (gap,) = bridge_force_gaps(np.array([[1.0], [np.nan], [3.0]]), 1000.0, "plate 1")[1]
    for language in LANGUAGES.keys() - {"en"}:
        with in_language(language):
            for message in (gap.message, SEVERAL_PEOPLE.message):
                assert 'lang="en"' not in served_text(message), (language, message)


def test_sentences_that_contain_others_are_translated_whole_or_not_at_all() -> None:
    along, lateral, vertical = (AxisLag(lag_s, 0.003, 0.9) for lag_s in (0.012, 0.0, 0.015))
    late = Latency(0.0134, 0.0032, along, lateral, vertical, 0.9)
    trials = SessionValues(session_id="s", latency_s=0.016, latency_sd_s=0.0015, latency_n_trials=3)
    latency = _describe_choice(LatencyChoice(late, 0.016, (), trials))
    applied = _applied_remark(0.016, f"as estimated in its session: {latency}.").message
    weighed = body_mass(None, None, [MassEstimate(66.8, 0.3, kind, 1.0) for kind in ("impulse", "standing")])
    with in_language("de"):
        assert served_text(applied) == (
            "Die Kraft wurde 16.0 ms später gelesen, wie geschätzt in ihrer Sitzung: 16.0 ± 1.5 ms über 3 Aufnahmen; "
            "diese allein: 13.4 ± 3.2 ms (12 ms längs des Gangs, 15 ms vertikal)."
        )
        (mass,) = (str(served_text(remark.message)) for remark in weighed.remarks)
        assert "Impuls der vertikalen Kraft" in mass
        assert "Stehen auf den Platten" in mass
        for code in ("head-missing", "trunk-simplified"):
            assert "(kostet etwa " in served_text(all_substitutes()[code].remark.message)
        unknown = applied.replace("as estimated in its session", "as guessed")
        assert served_text(unknown) == f'<span lang="en">{unknown}</span>'


def test_failed_check_is_stated_with_its_numbers() -> None:
    check = {"name": "force_residual", "value": 0.08, "unit": "1", "limit": 0.05, "contradicted_above": 0.2}
    quality = Quality.model_validate(
        {"verdict": "doubtful", "checks": [{**check, "passed": False, "message": "In English."}], "not_checked": {}}
    )
    with in_language("de"):
        shown = shown_quality({"quality": quality.model_dump()})
    assert shown is not None
    assert shown.reasons == ("Kraftresiduum des Ergebnisses: 8.0 %, erwartet höchstens 5.0 %.",)
    (failed,) = quality.checks
    assert _check_text(failed) == "In English."
    with in_language("de"):  # as the report names it
        assert _check_text(failed) == "Kraftresiduum: 8.0 %, erwartet höchstens 5.0 %."


def test_every_stage_and_activity_of_a_progress_message_is_translated() -> None:
    activities = (
        "looking at the scenario",
        "iteration 12, cost 3.1",
        "solving for 2.50 s",
        "1.0 of 4.0 s",
        "40 %, 1.0 of 4.0 s",
        "whole body at 1.0 s of 4.0 s",
        "pace 0.8",
    )
    shown = [progress_words(f"{stage}: {activity}") for stage in STAGE_WORDS for activity in activities]
    shown += [progress_words("start: waiting for the libraries"), "3 of 8 files read", "3 of 8 recordings fitted"]
    for language in LANGUAGES.keys() - {"en"}:
        with in_language(language):
            for text in shown:
                translated = served_text(text)
                assert 'lang="en"' not in translated, (language, text)
                assert translated != text, (language, text)
    with in_language("de"):
        assert served_text("planning the centre of mass: improved 12 times so far") == (
            "Bewegung des Schwerpunkts wird geplant: bisher 12-mal verbessert"
        )
        assert 'lang="en"' in served_text("planning the centre of mass: unknown activity")
