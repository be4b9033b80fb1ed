"""Rendering of templates."""

from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape
from starlette.requests import Request
from starlette.responses import HTMLResponse

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.schemas.service import Language
from stridelab.translations.catalogue import (
    ENGLISH,
    current_language,
    gettext,
    in_language,
    translate_count,
    translate_text,
)
from stridelab_web.assets import TEMPLATES
from stridelab_web.book.contents import section_page
from stridelab_web.config import WebConfig
from stridelab_web.formatting import FILTERS
from stridelab_web.languages import language_links, reader_language, script_catalogue

NAVIGATION: Final = (
    ("Home", "/"),
    ("Recordings", "/recordings"),
    ("Subjects", "/subjects"),
    ("Population", "/population"),
    ("Live", "/live"),
    ("Scenarios", "/scenarios"),
    ("Sweeps", "/sweeps"),
    ("Robots", "/robots"),
    ("Jobs", "/jobs"),
    ("Reproduction", "/reproduction"),
    ("Settings", "/settings"),
)
"""Sections of the pages with their addresses."""


def make_environment(config: WebConfig) -> Environment:
    """The template environment: all values are escaped, unknown names are errors."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.i18n"],
    )
    environment.policies["ext.i18n.trimmed"] = True
    environment.install_gettext_callables(translate_text, translate_count)  # type: ignore[attr-defined]
    environment.filters.update(FILTERS)
    environment.globals.update(
        version=config.version,
        login_required=config.token is not None,
        final_states=FINAL_STATES,
        navigation=NAVIGATION,
        section="",
        names={},
        section_page=section_page,
    )
    return environment


def render_page(request: Request, template: str, status_code: int = 200, **values: Any) -> HTMLResponse:
    """``template`` filled with ``values``; pages show the present state and must not be cached."""
    environment: Environment = request.app.state.environment
    language, reader = current_language(), reader_language(request)
    text = environment.get_template(template).render(
        embedded="embedded" in request.query_params,
        language=language,
        languages=language_links(request),
        reader_language=reader,
        english_only=_english_only_note(language, reader),
        messages_script=None if language == ENGLISH else script_catalogue(language)[1],
        **values,
    )
    return HTMLResponse(text, status_code=status_code, headers={"Cache-Control": "no-store"})


def _english_only_note(language: Language, reader: Language) -> str:
    """What a reader of another language sees on a page that is not translated."""
    if language == reader:
        return ""
    with in_language(reader):
        return gettext("This page exists in English only.")
