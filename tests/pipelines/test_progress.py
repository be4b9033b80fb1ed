"""Stages share the bar, keep the time, and put their name on every failure."""

import pytest

from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.progress import Stages
from support.command_line import RecordedProgress


def test_every_stage_has_its_share_and_its_name() -> None:
    progress = RecordedProgress()
    stages = Stages(progress, {"check": 1.0, "whole body": 3.0})
    with stages.run_stage("check", "looking"):
        pass
    with stages.run_stage("whole body", "0.0 of 24.0 s") as tell:
        tell(0.5, "12.0 of 24.0 s")
        tell(1.0, "24.0 of 24.0 s")
    assert progress.fractions == pytest.approx([0.0, 0.25, 0.625, 1.0])
    assert progress.messages[:3] == ["check: looking", "whole body: 0.0 of 24.0 s", "whole body: 12.0 of 24.0 s"]
    assert list(stages.times_s) == ["check", "whole body"]
    assert all(seconds >= 0.0 for seconds in stages.times_s.values())


def test_a_stage_that_overshoots_stays_in_its_part() -> None:
    progress = RecordedProgress()
    stages = Stages(progress, {"a": 1.0, "b": 1.0})
    with stages.run_stage("a", "one") as tell:
        tell(7.0, "too far")
    with stages.run_stage("b", "two"):
        pass
    assert progress.fractions == pytest.approx([0.0, 0.5, 0.5])


def test_an_error_keeps_its_class_and_code_and_names_the_stage() -> None:
    stages = Stages(RecordedProgress(), {"centroidal": 1.0})
    with pytest.raises(NotEstimable) as failure, stages.run_stage("centroidal", "solving"):
        raise NotEstimable("plan-not-converged", "It did not converge.", [Fault("solver", "ipopt")])
    error = failure.value
    assert type(error) is NotEstimable
    assert (error.code, error.message) == ("plan-not-converged", "It did not converge.")
    assert [fault.where for fault in error.faults] == ["solver", "stage: centroidal"]
    assert stages.times_s == {}, "a stage that failed has no time"


def test_a_subclass_remains_and_what_is_not_ours_goes_through() -> None:
    stages = Stages(RecordedProgress(), {"check": 1.0})
    with pytest.raises(InvalidInput), stages.run_stage("check", "looking"):
        raise InvalidInput("scenario-invalid", "No.")
    with pytest.raises(ZeroDivisionError), stages.run_stage("check", "looking"):
        raise ZeroDivisionError
