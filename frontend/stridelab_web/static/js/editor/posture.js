// The robot in a posture that the service has found, in place of the reference posture in which the scene puts it.
import { call } from "../shared/api.js";

const ROBOT = "/robot"; // viewer/initial_posture.py: the links hang below it
const NOWHERE = [0, 0, 0],
  UPRIGHT = [1, 0, 0, 0];

export class Posture {
  constructor() {
    this.robot = null;
    this.links = [];
    this.poses = null;
  }

  // Learns the names of the links, once for each robot.
  async of(robot) {
    if (robot === this.robot) return;
    Object.assign(this, { robot, links: [], poses: null });
    const facts = await call("GET", `/robots/${encodeURIComponent(robot)}`).catch(() => null);
    if (robot === this.robot) this.links = facts?.links ?? [];
  }

  // Poses of all links in the world, px, py, pz, qw, qx, qy, qz; null keeps those before.
  take(poses) {
    this.poses = poses ?? this.poses;
  }

  show(nodes) {
    if (!this.poses || this.poses.length !== this.links.length) return;
    nodes.pose(ROBOT, NOWHERE, UPRIGHT);
    for (const [k, link] of this.links.entries())
      nodes.pose(`${ROBOT}/${link}`, this.poses[k].slice(0, 3), this.poses[k].slice(3));
  }
}
