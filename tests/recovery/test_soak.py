"""The short form of ``make soak``, and that it sees what grows."""

import pytest

from support.load.growth import LIGHT, Sample, Soak, fit_growth
from support.load.load import ADMIN, users
from support.service.processes import running_service


def test_nothing_grows_but_what_belongs_to_jobs() -> None:
    with running_service(STRIDELAB_API_TOKEN=ADMIN) as service:
        soak = Soak(service, users(service.port, 2), LIGHT, seconds=9.0, round_s=3.0, clients=4)
        soak.run()
    assert len(soak.accepted) >= 12
    assert soak.faults() == []
    assert {"web server", "worker", "supervisor"} <= set(soak.samples[-1].memory_mb)


def test_growth_follows_the_trend_and_not_a_single_value() -> None:
    assert fit_growth([100.0 + 2.0 * n for n in range(11)]) == pytest.approx(20.0)
    assert fit_growth([100.0] * 5 + [500.0] + [100.0] * 5) == 0.0


@pytest.mark.parametrize(
    ("leak", "fault"),
    [
        (lambda n, sample: sample.memory_mb.update(worker=100.0 + 3.0 * n), "memory_mb of the worker"),
        (lambda n, sample: sample.files.update(worker=20 + 2 * n), "files of the worker"),
        (lambda n, sample: setattr(sample, "connections", 8 + 2 * n), "more and more connections"),
        (lambda n, sample: setattr(sample, "scratch", n), "folders of work in progress"),
        (lambda n, sample: sample.rows.update(worker=1 + n), "rows of worker"),
        (lambda n, sample: sample.rows.update(job_event=900 * n), "rows of job_event"),
        (lambda n, sample: setattr(sample, "blobs", 900 * n), "files for 110 jobs"),
    ],
)
def test_each_leak_is_reported(leak: object, fault: str) -> None:
    def made(n: int) -> Sample:
        sample = Sample(10 * n, {"worker": 100.0}, {"worker": 20}, {"worker": 1, "job_event": 0}, 8)
        if callable(leak):
            leak(n, sample)
        return sample

    soak = Soak(None, (), LIGHT, 0.0, 1.0, samples=[made(n) for n in range(12)])  # type: ignore[arg-type]  # not run
    assert len(soak.faults()) == 1
    assert fault in soak.faults()[0]
