// Starts the computation of a figure of the thesis.
import { onSubmit, startJob } from "./api.js";

onSubmit(document.querySelector("[data-reproduce]"), async (data) => {
  const seeds = data.get("seeds");
  const job = await startJob("reproduce", { item: data.get("item"), seeds: seeds ? Number(seeds) : null });
  location.assign(`/jobs/${job.id}`);
  return "Started.";
});
