// A walk of three phases: both feet, the left foot alone, both feet with the right one a step ahead.
/** @returns {any} */
export const contact = (effector, x, y, z = 0) => ({ effector, position_m: [x, y, z], orientation_wxyz: [1, 0, 0, 0] });
/** @returns {any} */
export const phase = (duration_s, ...contacts) => ({ duration_s, contacts });

export const LEFT = contact("left_foot", 0, 0.1);
export const RIGHT = contact("right_foot", 0, -0.1);
export const AHEAD = contact("right_foot", 0.4, -0.1);

/** @returns {any} */
export const walk = () => ({
  name: "walk",
  terrain: [{ kind: "box", name: "floor", center_m: [0, 0, -0.1], size_m: [10, 10, 0.2] }],
  phases: [phase(1, LEFT, RIGHT), phase(0.5, LEFT), phase(2, LEFT, AHEAD)],
});

export const durations = (scenario) => scenario.phases.map((each) => each.duration_s);
