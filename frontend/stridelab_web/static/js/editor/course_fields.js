// The obstacles of a course and their numbers: what the form shows, and what POST /scenarios/compose takes.

export const MAX_ELEMENTS = 20; // of POST /scenarios/compose

const CM = 0.01;
const DEGREE = Math.PI / 180;

/** @param {string} name @param {string} label @param {string} unit @param {number} value @param {number[]} range least, most, step @param {number} [factor] SI per unit */
const field = (name, label, unit, value, [min, max, step], factor = 1) => ({
  name,
  label,
  unit,
  value,
  min,
  max,
  step,
  factor,
});

/** @typedef {ReturnType<typeof field>} CourseField */
/** @typedef {{ kind: string, values: Record<string, number> }} CourseElement */

/** @type {Record<string, { title: string, fields: CourseField[] }>} */
export const KINDS = {
  stairs: {
    title: "Stairs",
    fields: [
      field("number", "Stairs", "", 4, [1, 40, 1]),
      field("rise_m", "Rise", "cm", 10, [-50, 50, 0.5], CM),
      field("depth_m", "Depth", "cm", 30, [5, 200, 0.5], CM),
    ],
  },
  level: {
    title: "Level ground",
    fields: [field("length_m", "Length", "m", 1, [0.05, 10, 0.05])],
  },
  beam: {
    title: "Beam",
    fields: [
      field("length_m", "Length", "m", 1.5, [0.05, 10, 0.05]),
      field("width_m", "Width", "cm", 45, [5, 600, 1], CM),
    ],
  },
  ramp: {
    title: "Ramp",
    fields: [
      field("length_m", "Length", "m", 1.5, [0.05, 10, 0.05]),
      field("slope_rad", "Slope", "°", 8, [-40, 40, 0.5], DEGREE),
    ],
  },
  stones: {
    title: "Stepping stones",
    fields: [
      field("number", "Stones", "", 4, [1, 40, 1]),
      field("spacing_m", "Spacing", "cm", 27, [5, 100, 0.5], CM),
      field("tilt_rad", "Tilt", "°", 0, [-40, 40, 0.5], DEGREE),
    ],
  },
  bar: {
    title: "Bar to step over",
    fields: [
      field("height_m", "Height", "cm", 6, [0.5, 100, 0.5], CM),
      field("thickness_m", "Thickness", "cm", 5, [0.5, 100, 0.5], CM),
    ],
  },
  box: {
    title: "Box",
    fields: [
      field("height_m", "Height", "cm", 10, [-50, 50, 0.5], CM),
      field("length_m", "Length", "cm", 40, [5, 200, 0.5], CM),
    ],
  },
  gap: { title: "Gap", fields: [field("length_m", "Length", "cm", 15, [1, 200, 0.5], CM)] },
};

// A new element with the default numbers of its kind, in the units of the form.
/** @param {string} kind @returns {CourseElement} */
export function newElement(kind) {
  return { kind, values: Object.fromEntries(KINDS[kind].fields.map(({ name, value }) => [name, value])) };
}

// An element as the interface takes it, in SI units; a beam is narrow level ground.
/** @param {CourseElement} element */
export function elementBody({ kind, values }) {
  const numbers = KINDS[kind].fields.map(({ name, factor }) => [name, round(values[name] * factor)]);
  return { kind: kind === "beam" ? "level" : kind, ...Object.fromEntries(numbers) };
}

// The numbers that a handle at the end of an element changes, by metres along the course and upwards.
/** @type {Record<string, (si: any, ahead_m: number, up_m: number) => Record<string, number>>} */
const DRAGGED = {
  stairs: (si, ahead_m, up_m) => ({
    depth_m: si.depth_m + ahead_m / si.number,
    rise_m: si.rise_m + up_m / si.number,
  }),
  level: (si, ahead_m) => ({ length_m: si.length_m + ahead_m }),
  beam: (si, ahead_m) => ({ length_m: si.length_m + ahead_m }),
  ramp: (si, ahead_m, up_m) => {
    const length_m = Math.max(si.length_m + ahead_m, 0.05);
    return { length_m, slope_rad: Math.atan2(si.length_m * Math.tan(si.slope_rad) + up_m, length_m) };
  },
  stones: (si, ahead_m) => ({ spacing_m: si.spacing_m + ahead_m / si.number }),
  bar: (si, ahead_m, up_m) => ({ thickness_m: si.thickness_m + ahead_m, height_m: si.height_m + up_m }),
  box: (si, ahead_m, up_m) => ({ length_m: si.length_m + ahead_m, height_m: si.height_m + up_m }),
};

// The element after its handle was dragged; its numbers stay within their ranges, at whole steps.
/** @param {CourseElement} element @param {number} ahead_m @param {number} up_m @returns {CourseElement} */
export function dragElement({ kind, values }, ahead_m, up_m) {
  const { fields } = KINDS[kind];
  const si = Object.fromEntries(fields.map(({ name, factor }) => [name, values[name] * factor]));
  const changed = Object.entries(DRAGGED[kind](si, ahead_m, up_m)).map(([name, value]) => {
    const { min, max, step, factor } = /** @type {CourseField} */ (fields.find((each) => each.name === name));
    const whole = Math.round(value / factor / step) * step;
    return [name, round(Math.min(Math.max(whole, min), max))];
  });
  return { kind, values: { ...values, ...Object.fromEntries(changed) } };
}

// The body of POST /scenarios/compose.
/** @param {{ name: string, robot: string, friction: number, width_m: number, handrails: string }} head @param {CourseElement[]} elements */
export function courseBody({ name, robot, friction, width_m, handrails }, elements) {
  return {
    name: name.trim() || "Course",
    robot,
    friction,
    width_m,
    handrails: handrails.split(" ").filter(Boolean),
    elements: elements.map(elementBody),
  };
}

// The list with one element moved by a number of places; the same list if it would leave it.
/** @template T @param {T[]} list @param {number} index @param {number} by @returns {T[]} */
export function moveItem(list, index, by) {
  const to = index + by;
  if (to < 0 || to >= list.length) return list;
  const moved = list.filter((_, k) => k !== index);
  moved.splice(to, 0, list[index]);
  return moved;
}

/** @param {number} value */
const round = (value) => Number(value.toFixed(6));
