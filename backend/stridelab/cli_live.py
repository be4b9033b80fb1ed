"""The command ``stridelab stream`` as it is typed; what it does is in ``cli_stream``."""

from pathlib import Path
from typing import Annotated

import typer

from stridelab.cli_groups import Estimation, Preparation, Walk, with_groups
from stridelab.cli_options import AsJson, Cutoffs, Latency, OnlineMethod, Token


@with_groups
def stream(
    *,
    walk: Walk,
    method: Annotated[OnlineMethod, typer.Option("--method", help="Online estimator.")] = "complementary",
    ahead: Annotated[str | None, typer.Option("--ahead", help="X,Y: where the walk goes; for the smoother.")] = None,
    latency: Latency = "apply",
    cutoffs: Cutoffs = "auto",
    preparation: Preparation,
    speed: Annotated[float, typer.Option("--speed", help="Times real time.")] = 1.0,
    block: Annotated[int, typer.Option("--block", help="Samples per message.")] = 1,
    packed: Annotated[bool, typer.Option("--packed", help="Packed float32 instead of JSON.")] = False,
    csv: Annotated[Path | None, typer.Option("--csv", help="Write the estimates to this file.")] = None,
    as_json: AsJson = False,
    server: Annotated[str, typer.Option("--server", help="The service.")] = "http://127.0.0.1:8000",
    token: Token = None,
) -> None:
    """Replay a recording in real time to a service that estimates its centre of mass online."""
    from stridelab.cli_estimate_request import EstimateRequest
    from stridelab.cli_stream import Replay
    from stridelab.cli_stream import stream as run

    request = EstimateRequest(walk, estimation=Estimation(latency=latency, cutoffs=cutoffs), preparation=preparation)
    replay = Replay(method=method, ahead=ahead, speed=speed, block=block, packed=packed, csv=csv)
    run(request, replay, as_json=as_json, server=server, token=token)
