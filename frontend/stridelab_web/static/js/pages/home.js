import { onSubmit, openNewJob } from "../shared/api.js";

onSubmit(document.querySelector("[data-simulate]"), (data) =>
  openNewJob("simulate-recording", { speed_m_s: Number(data.get("speed_m_s")), seed: Number(data.get("seed")) }),
);
