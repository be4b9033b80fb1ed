// Shows the robot in a posture that the service has solved, instead of its reference posture.
import { call } from "../shared/api.js";

const ROBOT = "/robot"; // the parent node of the links (viewer/initial_posture.py)
const ORIGIN = [0, 0, 0],
  IDENTITY = [1, 0, 0, 0];

export class RobotPosture {
  constructor() {
    this.robot = null;
    this.links = [];
    this.poses = null;
  }

  // Reads the names of the links, once per robot.
  async loadLinks(robot) {
    if (robot === this.robot) return;
    Object.assign(this, { robot, links: [], poses: null });
    const description = await call("GET", `/robots/${encodeURIComponent(robot)}`).catch(() => null);
    if (robot === this.robot) this.links = description?.links ?? [];
  }

  // Sets the poses of all links in the world, [px, py, pz, qw, qx, qy, qz] each; null keeps the present ones.
  setPoses(poses) {
    this.poses = poses ?? this.poses;
  }

  show(nodes) {
    if (!this.poses || this.poses.length !== this.links.length) return;
    nodes.setPose(ROBOT, ORIGIN, IDENTITY);
    for (const [k, link] of this.links.entries())
      nodes.setPose(`${ROBOT}/${link}`, this.poses[k].slice(0, 3), this.poses[k].slice(3));
  }
}
