"""``stridelab learn-reachability``: learns the density of a robot's CoM and writes a result folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from stridelab.cli.options import Delivery
from stridelab.cli.results import (
    out,
    progress_bar,
    refuse_to_overwrite,
    result_folder,
    show_files,
    show_json,
    show_remarks,
    validate_options,
    write_result,
)
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import LearnReachabilityInput, LearnReachabilitySummary
from stridelab.schemas.tasks import LearnReachabilityTask


def learn_reachability(
    options: Mapping[str, Any],
    delivery: Delivery,
) -> None:
    """Learn here or on a server, write the result folder and show the summary."""
    input_ = validate_options(
        LearnReachabilityInput, {key: value for key, value in options.items() if value is not None}
    )
    target = delivery.result_path(f"reachability-{Path(input_.robot).name}-{input_.measure}")
    refuse_to_overwrite(target, force=delivery.force)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = learn_here(input_, folder)
        else:
            from stridelab.cli.remote import run_remotely_as_is

            result = run_remotely_as_is(
                "learn-reachability", input_.robot, input_, folder, delivery.server, delivery.token
            )
    show_learned(result, target, as_json=delivery.as_json)


def learn_here(input_: LearnReachabilityInput, folder: Path) -> JobResult:
    """Run the job's own function in this process, with its worker processes."""
    with progress_bar(input_.robot) as bar:
        bar(0.0, "starting")
        from stridelab.service.kinds.learn_reachability import run as kind

        outcome = kind.run(LearnReachabilityTask(input=input_), folder, bar)
    return write_result(folder, "learn-reachability", input_, outcome)


def show_learned(result: JobResult, target: Path, *, as_json: bool) -> None:
    """Print one row per effector, or the result as JSON."""
    if as_json:
        show_json(result)
        return
    summary = LearnReachabilitySummary.model_validate(result.summary)
    out.print(
        f"[bold]{escape(summary.robot)}[/] {summary.measure}: {summary.samples} postures of {summary.tried}, "
        f"{100 * summary.rejected_share:.1f} % collided"
    )
    table = Table("", "components", "thesis", "KL (nats)", "held out (nats)", "kernels (m)", box=None, pad_edge=False)
    for name, effector in summary.effectors.items():
        table.add_row(
            escape(name),
            str(effector.components),
            str(effector.thesis_components),
            f"{effector.kl_nats:.4f} ± {effector.kl_sd_nats:.4f}",
            f"{effector.held_out_log_likelihood:.3f}",
            f"{effector.bandwidth_m:.3f}",
        )
    out.print(table)
    show_remarks(summary.warnings)
    show_files(result, target)
