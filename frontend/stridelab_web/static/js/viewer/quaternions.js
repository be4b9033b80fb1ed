// Quaternions wxyz.

// The shortest turn from the z axis to the direction d / norm.
export function towards(d, norm) {
  const [x, y, z] = d.map((v) => v / norm);
  if (z < -0.999999) return [0, 1, 0, 0];
  const half = Math.sqrt(2 * (1 + z));
  return [half / 2, -y / half, x / half, 0];
}

// A turn about the vertical, after the orientation that is there.
export function turned([w, x, y, z], angle_rad) {
  const c = Math.cos(angle_rad / 2),
    s = Math.sin(angle_rad / 2);
  return [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w];
}

// Where the x axis points, seen from above, in degrees.
export function yawOf([w, x, y, z]) {
  return (Math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z) * 180) / Math.PI;
}
