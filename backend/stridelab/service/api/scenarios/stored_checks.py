"""Whole-body checks of stored scenarios, computed in the background and cached for the latest ones."""

import asyncio
from collections import OrderedDict
from contextlib import suppress
from typing import Final

import anyio
import structlog

from stridelab.errors import Busy, StridelabError
from stridelab.schemas.base import Remark
from stridelab.schemas.scenarios import Scenario, ScenarioCheck, StoredScenario
from stridelab.service.api.previews.own_robots import OwnRobotPlanners
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.api.scenarios.bodies import UNFINISHED, add_body_checks
from stridelab.service.api.scenarios.validation import validate_scenario
from stridelab.service.processes.resident import Json, PreviewProcess

log = structlog.get_logger(__name__)

CACHED_CHECKS: Final = 256
PIECE_S: Final = 0.2
"""Duration of one request to the child process, between which the checks of an editor are answered."""
MAX_PIECES: Final = 400
_Key = tuple[str, str, str]
"""Id and entity tag of a scenario, and the version of a user's robot."""
PENDING: Final = Remark(code=UNFINISHED, message="the whole body is being checked; repeat the request for the result")


class StoredChecks:
    """Runs one whole-body check at a time, per version of a scenario and of a user's robot."""

    def __init__(
        self,
        bodies: PreviewProcess,
        planners: OwnRobotPlanners,
        limiter: anyio.CapacityLimiter,
        robots: RobotCache,
    ) -> None:
        self._bodies, self._planners, self._limiter, self._robots = bodies, planners, limiter, robots
        self._checks: OrderedDict[_Key, asyncio.Task[ScenarioCheck]] = OrderedDict()
        self._one_at_a_time = asyncio.Lock()

    async def start(self, stored: StoredScenario) -> None:
        """Check ``stored`` in the background unless that was started before; the oldest of too many is dropped."""
        self._started(stored, await self._key(stored))

    async def _key(self, stored: StoredScenario) -> _Key:
        return stored.id, stored.etag, await self._planners.version(stored.robot)

    def _started(self, stored: StoredScenario, key: _Key) -> "asyncio.Task[ScenarioCheck]":
        if key not in self._checks:
            scenario = Scenario.model_validate(stored.model_dump(include=set(Scenario.model_fields)))
            self._checks[key] = asyncio.get_running_loop().create_task(self._check_body(scenario))
            if len(self._checks) > CACHED_CHECKS:
                self._checks.popitem(last=False)[1].cancel()
        self._checks.move_to_end(key)
        return self._checks[key]

    async def check(self, stored: StoredScenario) -> ScenarioCheck:
        """The whole-body check if it is complete; else that of the learned reach, with the remark ``PENDING``.

        Raises the error of a failed whole-body check, which the next call repeats.
        """
        key = await self._key(stored)
        task = self._started(stored, key)
        if task.done():
            if task.cancelled() or task.exception() is not None:
                del self._checks[key]
            return task.result()
        plain = await validate_scenario(stored, self._limiter, self._robots)
        return plain.model_copy(update={"warnings": [*plain.warnings, PENDING]})

    async def aclose(self) -> None:
        """Cancel what is running."""
        for task in self._checks.values():
            task.cancel()
        with suppress(asyncio.CancelledError):
            await asyncio.gather(*self._checks.values(), return_exceptions=True)

    async def _ask_body(self, robot: str, request: Json) -> Json:
        return await self._planners.ask(robot, request, self._bodies)

    async def _check_body(self, scenario: Scenario) -> ScenarioCheck:
        async with self._one_at_a_time:
            plain = await validate_scenario(scenario, self._limiter, self._robots)
            whole = plain
            for _ in range(MAX_PIECES):
                try:
                    whole = await add_body_checks(scenario, plain, self._ask_body, None, PIECE_S)
                except Busy as busy:
                    await asyncio.sleep(busy.retry_after_s)
                    continue
                except StridelabError as error:
                    log.warning("stored scenario not checked", code=error.code)
                    raise
                if all(remark.code != UNFINISHED for remark in whole.warnings):
                    break
            return whole
