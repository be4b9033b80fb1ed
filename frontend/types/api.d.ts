// Written by scripts/make_api_types.py from the OpenAPI description of the service: edit the models there.

declare namespace Api {
  interface Artifact {
    name: string;
    media_type: string;
    bytes: number;
    sha256: string | null;
  }

  interface ContactMargin {
    phase: number;
    effector: string;
    surface: string | null;
    height_m: number | null;
    edge_m: number | null;
    reach_m: number | null;
  }

  interface FaultItem {
    where: string;
    message: string;
  }

  interface Job {
    id: string;
    kind: string;
    state: "queued" | "running" | "succeeded" | "failed" | "cancelled" | "timed_out";
    priority: number;
    progress: Progress;
    attempt: number;
    created_at: string;
    started_at: string | null;
    finished_at: string | null;
    error: Problem | null;
    queue_position: number | null;
    owner: string | null;
    recording_id: string | null;
    scenario_id: string | null;
    n_recordings: number | null;
    about: string | null;
    log_tail: string | null;
    has_result: boolean;
    verdict: JobVerdict | null;
  }

  interface JobResult {
    kind: string;
    input: Record<string, any>;
    versions: Record<string, string>;
    references: string[];
    summary: Record<string, any>;
    artifacts: Artifact[];
  }

  interface JobVerdict {
    outcome: "passed" | "doubtful" | "failed";
    code:
      | "certified"
      | "not-certified"
      | "replay-fell"
      | "replay-not-completed"
      | "replan-failed"
      | "every-replan-solved"
      | "sensors-agree"
      | "sensors-doubtful"
      | "sensors-contradict";
    message: string;
    failed_checks: string[];
  }

  interface LiveSession {
    session_id: string;
    title: string;
    robot: string;
    scenario_id: string | null;
    phase: "planning" | "running" | "paused" | "fallen" | "failed";
    n_watching: number;
    page: string;
    socket: string;
  }

  interface LiveStream {
    stream_id: string;
    title: string;
    marker_set: string;
    rate_hz: number;
    n_watching: number;
  }

  interface LiveStreams {
    items: LiveStream[];
  }

  interface PhaseBody {
    phase: number;
    body: "reachable" | "unreachable" | "not-asked";
    reason: string | null;
    limits: string[];
    link_poses: number[][] | null;
  }

  interface PhaseSupport {
    phase: number;
    margin_m: number | null;
    com_m: number[] | null;
  }

  interface PlanPreview {
    solver: string;
    duration_s: number;
    took_s: number;
    errors: FaultItem[];
    motion: PreviewMotion;
    recovered: PreviewMotion | null;
  }

  interface PreviewMotion {
    converged: boolean;
    status: string;
    objective: number | null;
    iterations: number;
    solve_time_s: number;
    time_s: number[];
    com_m: number[][];
  }

  interface Problem {
    type: string;
    title: string;
    status: number;
    code: string;
    detail: string;
    instance: string | null;
    errors: FaultItem[];
    request_id: string | null;
  }

  interface Progress {
    fraction: number;
    message: string;
    text: string;
  }

  interface Remark {
    code: string;
    message: string;
  }

  interface ScenarioCheck {
    valid: boolean;
    errors: FaultItem[];
    warnings: Remark[];
    margins: ContactMargin[];
    support_region_m: number[][][];
    support: PhaseSupport[];
    phases: PhaseBody[];
    duration_s: number;
  }
}
