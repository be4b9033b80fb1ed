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
