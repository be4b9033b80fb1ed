"""Subjects as the interface gives them, kept in memory."""

import uuid
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from stridelab.schemas.base import Problem
from stridelab.schemas.recordings import Recording, Subject, SubjectInput

_NOW = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)


def listed_recordings(kept: Iterable[Recording], query: Mapping[str, str]) -> dict[str, Any]:
    """The page of recordings that ``query`` asks for; a cursor is the number of those before it."""
    found = [one for one in reversed(list(kept)) if query.get("session_id") in (None, one.session_id)]
    if "subject_id" in query:
        found = [one for one in found if one.subject_id == query["subject_id"]]
    if "linked" in query:
        found = [one for one in found if (one.subject_id is not None) == (query["linked"] == "true")]
    start, limit = int(query.get("cursor", 0)), int(query.get("limit", 50))
    shown = [one.model_dump(mode="json") for one in found[start : start + limit]]
    return {"items": shown, "next": str(start + limit) if len(found) > start + limit else None}


class FakeSubjects:
    """Persons by their id."""

    def __init__(self, recordings: Mapping[str, Recording]) -> None:
        self.kept: dict[str, Subject] = {}
        self._recordings = recordings

    def add(self, name: str | None = "P07", **fields: Any) -> Subject:
        """A person."""
        made = Subject(subject_id=f"s{uuid.uuid4().hex[:12]}", created_at=_NOW, name=name, **fields)
        self.kept[made.subject_id] = made
        return made

    def routes(self, root: str) -> list[Route]:
        """The calls below ``root``."""
        return [
            Route(f"{root}/subjects", self._all, methods=["GET", "POST"]),
            Route(f"{root}/subjects/{{id}}", self._one, methods=["GET", "PATCH", "DELETE"]),
        ]

    def _shown(self, one: Subject) -> dict[str, Any]:
        linked = sum(recording.subject_id == one.subject_id for recording in self._recordings.values())
        return one.model_copy(update={"n_recordings": linked}).model_dump(mode="json")

    async def _all(self, request: Request) -> Response:
        if request.method == "GET":
            newest = [self._shown(one) for one in reversed(self.kept.values())]
            return JSONResponse({"items": newest, "next": None})
        given = SubjectInput.model_validate(await request.json())
        return JSONResponse(self.add(**given.model_dump()).model_dump(mode="json"), 201)

    async def _one(self, request: Request) -> Response:
        key = request.path_params["id"]
        if key not in self.kept:
            said = Problem(title="404", status=404, code="subject-not-found", detail="There is no such subject.")
            return Response(said.model_dump_json(), 404, media_type="application/problem+json")
        if request.method == "DELETE":
            del self.kept[key]
            return Response(status_code=204)
        if request.method == "PATCH":
            given = SubjectInput.model_validate(await request.json()).model_dump(exclude_unset=True)
            self.kept[key] = self.kept[key].model_copy(update=given)
        return JSONResponse(self._shown(self.kept[key]))
