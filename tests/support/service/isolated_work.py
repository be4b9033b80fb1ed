"""Work for ``map_isolated``: what an item can do to its process."""

import os
import time

from stridelab.errors import Fault, NotEstimable
from stridelab.service.kinds.base import Json


def behave(item: Json) -> Json:
    """Do what ``item["how"]`` says."""
    how = item["how"]
    if how == "crash":
        os.abort()
    if how == "exit":
        os._exit(3)
    if how == "hang":
        time.sleep(60)
    if how == "refuse":
        raise NotEstimable("no-step", "There is no step.", [Fault("walk.c3d", "standing")])
    if how == "break":
        raise RuntimeError("unforeseen")
    if how == "interval":
        began_s = time.monotonic()
        time.sleep(0.5)
        return {"interval_s": [began_s, time.monotonic()]}
    if how == "large":
        return {"text": "x" * 3_000_000}
    return {"pid": os.getpid(), "twice": 2 * item["n"]}
