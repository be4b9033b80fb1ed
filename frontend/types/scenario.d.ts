// Scenarios as the scripts edit them, and their validation as the service sends it.

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
  robot: string;
  friction: number;
  terrain: Surface[];
  phases: Phase[];
}

// A contact of one effector that stays at its place from the first to the last of `phases` (scene/contacts.py).
interface Touch {
  number: number;
  effector: string;
  phases: [number, number];
  node: string;
  side: string;
  surface: boolean;
  start_s: number;
  end_s: number;
  position_m: number[];
  orientation_wxyz: number[];
  yaw_deg: number;
}

type ScenarioEdit = (scenario: Scenario) => Scenario;

// What the phase timeline reports to the editor.
interface TimelineCallbacks {
  onChoosePhase(k: number): void;
  onChooseContact(number: number): void;
  onToggle(k: number, effector: string): void;
  onPropose(edit: ScenarioEdit): void;
  onCommit(edit: ScenarioEdit, done: string): void;
  onKeyEdit(key: string, edit: ScenarioEdit, done: string): void;
  onDiscard(): void;
}

// An error that names a place in the scenario, such as phases[2].contacts[left_foot].
interface PlacedError {
  where: string;
  message: string;
}

type ContactMargin = Api.ContactMargin;
type ScenarioCheck = Api.ScenarioCheck; // the answer of /scenarios/check

type PhaseState = Phase & Omit<Api.PhaseSupport, "phase"> & { kind: string; region_m: number[][] };

// What scripts are given of a job, and of a problem: a proxy may answer with less. Written from the service's models.
type Job = Pick<Api.Job, "id" | "state" | "progress"> & Partial<Omit<Api.Job, "error">> & { error?: ApiProblem | null };
type ApiProblem = Pick<Api.Problem, "title"> & Partial<Api.Problem>;
