"""The command ``stridelab fit-cycloid`` as it is typed; what it does is in ``cli_cycloid``."""

from stridelab.cli_groups import Delivery, Estimation, Preparation, Walk, with_groups
from stridelab.cli_options import BestMethod, StepChoice


@with_groups
def fit_cycloid(
    *,
    walk: Walk,
    steps: StepChoice = "measured",
    method: BestMethod = None,
    estimation: Estimation,
    preparation: Preparation,
    delivery: Delivery,
) -> None:
    """Fit the rolling wheel to every step of one recording; needs no server."""
    from stridelab.cli_cycloid import fit as run
    from stridelab.cli_estimate_request import EstimateRequest

    request = EstimateRequest(walk, method, estimation, preparation, steps)
    run(request, delivery)
