import { onSubmit, startJob } from "../shared/api.js";

onSubmit(document.querySelector("[data-simulate]"), async (data) => {
  const input = { speed_m_s: Number(data.get("speed_m_s")), seed: Number(data.get("seed")) };
  const job = await startJob("simulate-recording", input);
  location.assign(`/jobs/${job.id}`);
  return "started";
});
