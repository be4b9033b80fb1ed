"""The types of answers of the service, against which the pages' scripts are checked."""

from make_api_types import TARGET, api_types
from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings


def test_the_types_of_answers_are_those_of_the_service() -> None:
    text = api_types(create_app(Settings()).openapi()["components"]["schemas"])
    assert TARGET.read_text() == text, "run scripts/make_api_types.py"


def test_types_follow_the_schemas() -> None:
    job = TARGET.read_text().partition("interface Job {")[2].partition("}")[0]
    assert '    state: "queued" | "running" | "succeeded" | "failed" | "cancelled" | "timed_out";\n' in job
    assert "    error: Problem | null;\n" in job
