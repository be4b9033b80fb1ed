// Courses to start from: flights with the sizes of building codes, and one that none of the bundled robots climbs.
import { newElement } from "./course_fields.js";

/** @typedef {{ title: string, name: string, handrails: string, number: number, rise_m: number, depth_m: number }} Preset */

/** @type {Record<string, Preset>} */
export const PRESETS = {
  house: {
    title: "Stairs of a house, 17 × 28 cm",
    name: "Stairs of a house",
    handrails: "left right",
    number: 5,
    rise_m: 17,
    depth_m: 28,
  },
  outdoor: {
    title: "Outdoor stairs, 14 × 37 cm",
    name: "Outdoor stairs",
    handrails: "",
    number: 6,
    rise_m: 14,
    depth_m: 37,
  },
  ladder: {
    title: "Steep as a ladder, 25 × 20 cm",
    name: "Steep stairs",
    handrails: "left right",
    number: 5,
    rise_m: 25,
    depth_m: 20,
  },
};

// What the form shows of a preset; robot, width and friction stay as they are.
/** @param {string} key @param {Record<string, any>} head */
export function presetCourse(key, head) {
  const { name, handrails, number, rise_m, depth_m } = PRESETS[key];
  const stairs = newElement("stairs");
  return {
    head: { ...head, name, handrails },
    elements: [{ ...stairs, values: { ...stairs.values, number, rise_m, depth_m } }],
  };
}
