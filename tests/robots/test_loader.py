"""TALOS as loaded, against figures that do not come from this project."""

from stridelab.robots.loader import load_robot, robot_names


def test_talos_is_known_and_loads() -> None:
    assert "talos" in robot_names()
    assert len(load_robot("talos").joint_names) == 28
