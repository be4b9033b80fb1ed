// What scenes are drawn from: the layout of frames (stridelab_web/scene/frames.py), live robots, and the curves of a page
// (stridelab_web/charts/plotly.py).

interface FrameLayout {
  n_frames: number;
  width: number;
  bits: number[];
  time_s: number[];
  points: [name: string, column: number, label: string][];
  bodies: [name: string, column: number][];
  sticks: [name: string, start: number, end: number][];
  arrows: [shaft: string, head: string, column: number, label: string][];
  ellipsoids: [name: string, column: number, axes: number][];
  hoops: [name: string, column: number, size: number][];
  spans: [name: string, start_s: number, end_s: number][];
  still: string[];
  copies: [name: string, of: string, paint: [number[], number] | null][];
  phase_starts_s: number[];
  arrow_m_per_n: number;
  head_m: number;
  gone: string[];
}

// What a camera is told of a scene.
interface MovingScene {
  nodes: { viser: ViserClient };
  layout: Pick<FrameLayout, "n_frames" | "width" | "bodies" | "sticks"> & {
    points: [string, number, ...unknown[]][];
  };
  values: ArrayLike<number>;
}

// A frame of a live robot, with its forces as arrows.
interface LiveFrame {
  time_s: number;
  plan_time_s: number;
  links: number[][];
  com_m: number[];
  capture_m: number[];
  foothold_m: number[] | null;
  ground_m: number;
  horizon_m: number[][];
  footholds: { effector: string; position_m: number[]; yaw_rad: number }[];
  forces_n: Record<string, number[]>;
  effectors_m: Record<string, number[]>;
  doing: "plan" | "steered" | "recovery" | "fallen";
  steps: number;
  is_planning: boolean;
  not_resumed: string;
  velocity: [ahead: number, left: number, turn: number] | null;
  push: { number: number; link: number | null; since_s: number; impulse_ns: number[] } | null;
  arrows: { at: number[]; force: number[] }[];
}

interface LiveState {
  phase: "planning" | "running" | "paused" | "fallen" | "failed";
  message: string;
  problem: ApiProblem | null;
  may_push: boolean;
  n_watching: number;
  pace: number | null;
  settings: Record<string, number | null> & { pace: number };
  robot: LiveRobot | null;
}

interface LiveRobot {
  links: string[];
  soles_m: Record<string, number[]>;
  mass_kg: number;
  may_steer: boolean;
  duration_s: number;
}

interface PlotTrace {
  key: string;
  name: string;
  style: string;
  sd: string | null;
  group: string | null;
  listed: boolean;
}

interface PlotRow {
  title: string;
  traces: PlotTrace[];
  legend: boolean;
  log: boolean;
  steps: boolean;
}

interface PlotReading {
  name: string;
  key: string;
  unit: string;
  digits: number;
  sd: string | null;
  more: string[];
  group: string | null;
}

interface PlotAxis {
  key: string;
  name: string;
  title: string;
  unit: string;
  digits: number;
  log: boolean;
}

type PlotColumns = Record<string, (number | null)[]>;

interface PlotDocument {
  columns: PlotColumns;
  rows: PlotRow[];
  readings: PlotReading[];
  shades_s: [number, number][];
  switches: { key: string; name: string; style: string; shown: boolean }[];
  x: PlotAxis;
}

// The densities of one effector (reach.json).
interface DensityMap {
  right: string;
  up: string;
  right_m: number[];
  up_m: number[];
  kernel_per_m2: number[][];
  mixture_per_m2: number[][];
  [key: string]: any;
}

interface Density {
  effector: string;
  components: number;
  frame: string;
  maps: DensityMap[];
  volumes_m3: Record<string, number>;
}

// An instant of the editor's playback of a plan.
interface PlanInstant {
  phase: number;
  com_m: number[] | null;
  poses: number[][] | null;
  ghost: number[][] | null;
}

// What a film is made of: `seek` draws an instant, `settled` returns whether it is drawn.
interface FilmSource {
  viser(): ViserClient;
  name(): string;
  range_s(): number[];
  speed(): number;
  seek(t_s: number): void;
  redraw(): void;
  settled(): boolean;
  restore(): void;
}
