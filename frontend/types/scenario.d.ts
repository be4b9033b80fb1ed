// Scenarios and their validation as the service sends them; only what the scripts read.

interface Contact {
  effector: string;
  position_m: number[];
  orientation_wxyz: number[];
}

interface Phase {
  duration_s: number;
  contacts: Contact[];
}

interface Box {
  kind: "box";
  name: string;
  center_m: number[];
  size_m: number[];
  yaw_rad?: number | null;
  orientation_wxyz?: number[] | null;
  friction?: number | null;
}

interface Rail {
  kind: "rail";
  name: string;
  from_m: number[];
  to_m: number[];
  radius_m: number;
  friction?: number | null;
}

type Surface = Box | Rail;

interface Scenario {
  name: string;
  friction: number;
  terrain: Surface[];
  phases: Phase[];
}

// A contact of one effector that stays at its place from the first to the last of `phases`.
interface Touch {
  number: number;
  effector: string;
  phases: [number, number];
}

// An error that names a place in the scenario, such as phases[2].contacts[left_foot].
interface PlacedError {
  where: string;
  message: string;
}

interface ContactMargin {
  phase: number;
  effector: string;
  surface: string;
  edge_m: number | null;
  height_m: number | null;
  reach_m: number | null;
}

// The answer of /scenarios/check.
interface ScenarioCheck {
  errors: PlacedError[];
  warnings: { code: string; message: string }[];
  margins: ContactMargin[];
  support: { margin_m: number | null; com_m: number[] | null }[];
  support_region_m: number[][][];
  phases: { phase: number; body: string; reason: string; link_poses?: number[][] }[];
}

type PhaseState = Phase & ScenarioCheck["support"][number] & { kind: string; region_m: number[][] };

interface Job {
  id: string;
  state: string;
  error?: ApiProblem | null;
  queue_position?: number | null;
  progress: { fraction: number; message: string };
  verdict?: { outcome: string; message: string } | null;
}

interface ApiProblem {
  title: string;
  detail?: string;
  errors?: PlacedError[];
}
