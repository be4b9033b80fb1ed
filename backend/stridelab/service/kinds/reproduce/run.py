"""``reproduce``: recomputes a figure of the thesis, with its tables and the drawing as SVG."""

from dataclasses import asdict
from pathlib import Path
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.reproduction.claims import sampling_text
from stridelab.reproduction.registry import ITEMS, command_of, seeds_of
from stridelab.reproduction.report.formatting import holds_text, overturned_by, uncertainty_text
from stridelab.schemas.reproduction import ClaimResult, ReproduceSummary, ReproduceTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_table, write_text_atomically

SVG: Final = "image/svg+xml"


def run(task: ReproduceTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Reproduce into ``folder``; the summary is a ``ReproduceSummary``.

    Raises ``Unavailable`` (``robot-data-missing``) if the robot is not installed.
    """
    request = task.input
    item = ITEMS[request.item]
    seeds = seeds_of(item, request.seeds, request.seed)
    reproduction = item(seeds, lambda fraction, message: progress(0.95 * fraction, message))
    progress(0.95, "writing the result")
    summary = ReproduceSummary(
        item=item.name,
        title=item.title,
        verdict=reproduction.verdict,
        thesis={claim.key: claim.thesis for claim in reproduction.claims},
        ours={claim.key: claim.ours for claim in reproduction.claims},
        claims=[
            ClaimResult(
                **asdict(claim),
                holds=holds_text(claim),
                overturned_by=overturned_by(claim),
                uncertainty=uncertainty_text(claim),
            )
            for claim in reproduction.claims
        ],
        seeds=len(seeds),
        seed=seeds[0],
        sampling=sampling_text(item.draws, seeds),
        command=command_of(item, seeds),
        note=reproduction.note,
    )
    drawing = f"{item.name}.svg"
    write_text_atomically(folder / drawing, reproduction.drawing)
    provenance = {"item": item.name, "seeds": len(seeds), "seed": seeds[0]}
    tables = [
        file for name, columns in reproduction.tables.items() for file in write_table(folder, name, columns, provenance)
    ]
    progress(1.0, "done")
    return Outcome(summary.model_dump(mode="json"), reproduction.references, (ArtifactFile(drawing, SVG), *tables))
