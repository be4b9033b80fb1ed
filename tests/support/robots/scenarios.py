"""Scenarios that a certificate or a replay has to refuse: legs that cross on a beam, hands that hook a table."""

from stridelab.contacts.scenarios.parts import (
    HRP2,
    TALOS,
    Scenario,
    Timing,
    both_feet,
    box,
    contact,
    ground,
    move_effector,
    phase,
    scenario,
)

BEAM_M = 0.20
BEAM_TOP_M = 0.10
TABLE_TOP_M = 0.75


def narrow_beam(n_steps: int = 3, step_m: float = 0.25, foot_y_m: float = 0.03) -> Scenario:
    """HRP-2 along a beam 0.20 m wide, one foot before the other: a leg that swings goes through the other one."""
    timing = Timing(1.5, 1.2, 0.3)
    x_m = {"right_foot": 0.0, "left_foot": step_m}
    y_m = {"right_foot": -foot_y_m, "left_foot": foot_y_m}
    standing = {name: contact(name, (x_m[name], y_m[name], BEAM_TOP_M)) for name in x_m}
    phases = [phase(timing.ends_s, standing)]
    for i in range(n_steps):
        name = ("right_foot", "left_foot")[i % 2]
        x_m[name] = max(x_m.values()) + step_m
        phases += move_effector(standing, contact(name, (x_m[name], y_m[name], BEAM_TOP_M)), timing)
    phases[-1]["duration_s"] = timing.ends_s
    beam = box("beam", (-0.5, 4.0), (-BEAM_M / 2, BEAM_M / 2), (0.0, BEAM_TOP_M))
    return scenario("A narrow beam", "Feet one before the other.", HRP2.robot, [ground(), beam], phases)


def both_hands_on_a_table(edge_x_m: float = 0.35, hand_x_m: float = 0.50, hand_y_m: float = 0.30) -> Scenario:
    """TALOS puts both hands on a table, its way up to them leading through the edge, then the right foot back."""
    timing = Timing(2.0, 1.6, 0.3)
    standing = both_feet(TALOS, 0.0, 0.0)
    phases = [phase(timing.ends_s, standing)]
    for name, y_m in (("left_hand", hand_y_m), ("right_hand", -hand_y_m)):
        phases += move_effector(standing, contact(name, (hand_x_m, y_m, TABLE_TOP_M)), timing)
    phases += move_effector(standing, contact("right_foot", (-0.2, -TALOS.foot_y_m, 0.0)), timing)
    phases[-1]["duration_s"] = timing.ends_s
    table = box("table", (edge_x_m, edge_x_m + 0.8), (-0.6, 0.6), (TABLE_TOP_M - 0.04, TABLE_TOP_M), friction=0.6)
    return scenario("Hands on a table", "Both hands, then a step back.", TALOS.robot, [ground(), table], phases)
