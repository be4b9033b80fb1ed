"""Resumes the plan of a live robot after a recovery: planned in a second process while the robot goes on standing."""

from typing import Final

import numpy as np

from stridelab.errors import StridelabError
from stridelab.machine.parallel import WorkBeside
from stridelab.wholebody.replay.resumption import NotResumed, Resume, Resumption
from stridelab.wholebody.replay.sensors import SensedState
from stridelab.wholebody.replay.stepper import ReplayStepper

MOVED_M: Final = 0.005
"""Displacement of a sole since the planning began from which the plan is of no use."""
NICENESS: Final = 10
"""Priority of the planning below that of the simulation."""


class PlanResuming:
    """The resumption of one stepper's plan. Without ``resume``, the robot stands where it came to rest.

    ``reason`` says why the plan is not resumed from there, empty while that is not known.
    """

    def __init__(self, stepper: ReplayStepper, resume: Resume | None) -> None:
        self._stepper, self._resume = stepper, resume
        self._work: WorkBeside[Resumption | NotResumed] | None = None
        self._from: SensedState | None = None
        self.reason = ""

    @property
    def is_planning(self) -> bool:
        """Whether a plan is being computed."""
        return self._work is not None

    def follow_rest(self) -> bool:
        """Call when a recovery has come to rest: begins to plan, or resumes a plan that is ready; True if resumed."""
        resume = self._resume
        if resume is None or (self._work is None and self._from is not None and self._stands_still(self._from)):
            return False
        if self._work is None:
            measured, left_s = self._stepper.measured_state(), self._stepper.plan_time_s
            self._from, self.reason = measured, ""
            if WorkBeside.is_possible():
                self._work = WorkBeside(lambda: resume(left_s, measured), NICENESS)
            return False
        if not self._work.has_ended:
            return False
        return self._resume_with(self._work)

    def cancel_planning(self) -> None:
        """Forget what is being planned: the robot is moved, steered or set back."""
        if self._work is not None:
            self._work.end_process()
        self._work, self._from, self.reason = None, None, ""

    def _resume_with(self, work: "WorkBeside[Resumption | NotResumed]") -> bool:
        try:
            found = work.wait_for_result()
        except (StridelabError, MemoryError) as error:
            found = NotResumed(str(error).rstrip("."))
        begun_from = self._from
        self.cancel_planning()
        if begun_from is None or not self._stands_still(begun_from):
            return False  # the next rest plans anew
        if isinstance(found, NotResumed):
            self._from, self.reason = begun_from, found.reason
            return False
        return self._stepper.resume_plan(lambda _left_s, _measured: found, limited=False)

    def _stands_still(self, before: SensedState) -> bool:
        """Whether the effectors are where they were."""
        now = self._stepper.measured_state().contacts
        moved_m = [np.linalg.norm(now[name].position_m - one.position_m) for name, one in before.contacts.items()]
        return float(max(moved_m, default=0.0)) < MOVED_M
