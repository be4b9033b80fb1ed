"""The random drags that the editor's verdict is measured on, and the verdict of one of them."""

import numpy as np
import pytest

from experiments.drags import MAX_DRAG_M, check_drag, draw_drag
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.scenarios.validation import validate_sync
from stridelab.service.samples.scenarios import bundled_scenarios


@pytest.mark.parametrize("robot", ["talos", "hrp2"])
def test_a_drag_moves_one_contact_along_its_surface_and_is_accepted(robot: str) -> None:
    for seed in range(5):
        drag = draw_drag(robot, seed)
        assert drag == draw_drag(robot, seed)
        assert validate_sync(Scenario.model_validate(drag.scenario)).valid
        before, moved = bundled_scenarios()[drag.scene]["phases"], []
        for old, new in zip(before, drag.scenario["phases"], strict=True):
            for a, b in zip(old["contacts"], new["contacts"], strict=True):
                if a != b:
                    assert a["effector"] == drag.effector
                    moved.append(np.subtract(b["position_m"], a["position_m"]))
                    w, *axis = a["orientation_wxyz"]
                    normal = np.array([0.0, 0.0, 1.0])
                    normal = normal + 2.0 * np.cross(axis, np.cross(axis, normal) + w * normal)
                    assert moved[-1] @ normal == pytest.approx(0.0, abs=1e-9)
        assert moved
        assert np.ptp(moved, axis=0).max() < 1e-9, "in all phases by as much"
        assert 0.0 < np.linalg.norm(moved[0]) <= MAX_DRAG_M


def test_a_verdict_is_complete_after_several_requests() -> None:
    said = check_drag(draw_drag("talos", 20009))
    assert said.requests > 1
    assert 0.0 < said.first_s < said.complete_s
    assert said.longest_s < said.complete_s
    assert (said.valid, said.stances, said.reason) == (True, True, "")
