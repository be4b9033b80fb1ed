// Shows the robot in a posture that the service has solved, instead of its reference posture.
import { call } from "../shared/api.js";
import { MeshCopies } from "../viewer/mesh_copies.js";

const ROBOT = "/robot", // the parent nodes of the links (viewer/initial_posture.py)
  GHOST = "/ghost";
/** @type {[number[], number]} */
const PALE = [[70, 110, 200], 0.4]; // as in scene/plan_frames.py
const ORIGIN = [0, 0, 0],
  IDENTITY = [1, 0, 0, 0];

export class RobotPosture {
  constructor() {
    /** @type {string | null} */
    this.robot = null;
    /** @type {string[]} */
    this.links = [];
    /** @type {number[][] | null} */
    this.poses = null;
    this.copies = new MeshCopies([]);
  }

  // Reads the names of the links, once per robot.
  /** @param {string} robot */
  async loadLinks(robot) {
    if (robot === this.robot) return;
    Object.assign(this, { robot, links: [], poses: null });
    const description = await call("GET", `/robots/${encodeURIComponent(robot)}`).catch(() => null);
    if (robot !== this.robot) return;
    this.links = description?.links ?? [];
    this.copies = new MeshCopies(this.links.map((link) => [`${GHOST}/${link}`, `${ROBOT}/${link}`, PALE]));
  }

  // Sets the poses of all links in the world, [px, py, pz, qw, qx, qy, qz] each; null keeps the present ones.
  /** @param {number[][]} poses */
  setPoses(poses) {
    this.poses = poses ?? this.poses;
  }

  /** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes */
  show(nodes) {
    this.place(nodes, ROBOT, this.poses);
  }

  // Shows a second, pale robot in other poses; null hides it.
  /** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes @param {number[][] | null} poses */
  showGhost(nodes, poses) {
    const isShown = poses?.length === this.links.length;
    if (poses && isShown) {
      this.copies.update(nodes.viser.nodeRefFromName);
      this.place(nodes, GHOST, poses);
    }
    nodes.setVisible(GHOST, isShown);
  }

  /** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes @param {string} group @param {number[][] | null} poses */
  place(nodes, group, poses) {
    if (!poses || poses.length !== this.links.length) return;
    nodes.setPose(group, ORIGIN, IDENTITY);
    for (const [k, link] of this.links.entries())
      nodes.setPose(`${group}/${link}`, poses[k].slice(0, 3), poses[k].slice(3));
  }
}
