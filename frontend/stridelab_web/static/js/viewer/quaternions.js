// Unit quaternions [w, x, y, z].

// The shortest rotation of the z axis to direction / norm.
/** @param {number[]} direction @param {number} norm */
export function rotationFromZ(direction, norm) {
  const [x, y, z] = direction.map((v) => v / norm);
  if (z < -0.999999) return [0, 1, 0, 0];
  const half = Math.sqrt(2 * (1 + z));
  return [half / 2, -y / half, x / half, 0];
}

// The orientation rotated by an angle about the vertical axis of the world.
/** @param {number[]} wxyz @param {number} angle_rad */
export function rotateAboutZ([w, x, y, z], angle_rad) {
  const c = Math.cos(angle_rad / 2),
    s = Math.sin(angle_rad / 2);
  return [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w];
}

// The yaw angle of the x axis, in degrees.
/** @param {number[]} wxyz */
export function yawDegrees([w, x, y, z]) {
  return (Math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z) * 180) / Math.PI;
}

/** @param {number[]} a @param {number[]} b */
export function multiply([a, b, c, d], [w, x, y, z]) {
  return [
    a * w - b * x - c * y - d * z,
    a * x + b * w + c * z - d * y,
    a * y - b * z + c * w + d * x,
    a * z + b * y - c * x + d * w,
  ];
}

/** @param {number[]} wxyz */
export const conjugate = ([w, x, y, z]) => [w, -x, -y, -z];

// A vector rotated by a quaternion.
/** @param {number[]} wxyz @param {number[]} vector */
export const rotate = (wxyz, vector) => multiply(multiply(wxyz, [0, ...vector]), conjugate(wxyz)).slice(1);

// The orientation of angles in radians: lean about x, then slope (upwards along x), then turn about z.
/** @param {number} turn @param {number} slope @param {number} lean */
export function fromAngles(turn, slope, lean) {
  const about = (/** @type {number} */ angle, /** @type {number} */ axis) => {
    const wxyz = [Math.cos(angle / 2), 0, 0, 0];
    wxyz[axis] = Math.sin(angle / 2);
    return wxyz;
  };
  return multiply(multiply(about(turn, 3), about(-slope, 2)), about(lean, 1));
}

// The angles of an orientation, [turn, slope, lean].
/** @param {number[]} wxyz */
export function toAngles([w, x, y, z]) {
  const slope = Math.asin(Math.min(Math.max(2 * (x * z - w * y), -1), 1));
  const lean = Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  return [Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), slope, lean];
}
