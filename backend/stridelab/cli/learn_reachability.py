"""``stridelab learn-reachability``: learns the density of a robot's CoM and writes a result folder."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.deliver import deliver_result, run_job
from stridelab.cli.options import Delivery, PostureMeasure, with_groups
from stridelab.cli.results import out, show_files, show_remarks, validate_options
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import LearnReachabilityInput, LearnReachabilitySummary, LearnReachabilityTask


@with_groups
def learn_reachability(
    *,
    robot: Annotated[str, typer.Argument(help="A robot by name: talos, hrp2, g1.")],
    measure: Annotated[
        PostureMeasure,
        typer.Option("--measure", help="How postures are sampled: uniformly, or conditioned on standing."),
    ] = "uniform",
    samples: Annotated[int | None, typer.Option("--samples", help="Number of valid postures, 500 to 200000.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the postures and of the fits.")] = None,
    effector: Annotated[
        list[str] | None, typer.Option("--effector", help="Learn this effector only; may be repeated.")
    ] = None,
    delivery: Delivery,
) -> None:
    """Learn the density of a robot's centre of mass relative to its effectors; needs no server."""
    options = {"robot": robot, "measure": measure, "samples": samples, "seed": seed, "effectors": effector or None}
    input_ = validate_options(
        LearnReachabilityInput, {key: value for key, value in options.items() if value is not None}
    )
    name, task = input_.robot, LearnReachabilityTask(input=input_)
    deliver_result(
        f"reachability-{Path(name).name}-{input_.measure}",
        delivery,
        lambda folder: run_job("learn-reachability", name, task, folder, delivery),
        show_learned,
    )


def show_learned(result: JobResult, target: Path) -> None:
    """Print one row per effector."""
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
