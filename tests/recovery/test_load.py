"""The short form of ``make load``: what is answered, not how fast."""

import asyncio

from support.load.load import ADMIN, Load, users
from support.service.processes import assert_sound, running_service

SETTINGS = {"STRIDELAB_API_TOKEN": ADMIN, "STRIDELAB_QUEUE_LIMIT": "60", "STRIDELAB_USER_QUEUE_LIMIT": "15"}


def test_a_crowd_gets_answers_and_every_accepted_job_ends_once() -> None:
    task = ("reproduce", {"item": "fig-2.5"})
    with running_service(**SETTINGS) as service:
        load = Load(service.port, users(service.port, 2), task, clients=20, seconds=5.0, many=30)
        tally = asyncio.run(load.run())
        assert_sound(service.url, service.folder / "blobs", tally.accepted, timeout_s=60.0)
    assert tally.worse == 0, (tally.failures, tally.statuses)
    assert {status for _, status in tally.statuses} <= {200, 202, 429}
    assert set(tally.refusals) <= {"queue-full", "user-queue-full"}
    assert len(tally.took_s["look"]) > 20
    assert tally.events > 0
    # two jobs may have been fetched while the single one was submitted, and one of each rival goes first
    assert tally.overtaken
    assert max(tally.overtaken) <= 3
