"""``make soak``: a whole service at work for half an hour; prints what grew, and fails where it should not have."""

import argparse
import os
import sys
import time

from support.load.growth import Soak
from support.load.load import ADMIN, NICENESS, TASK, real_service, users
from support.service.processes import running_service

LIGHT: tuple[str, dict[str, object]] = ("reproduce", {"item": "fig-2.5"})
"""With the tests' worker, a job that computes nothing: many of them pass in little time."""


def main() -> None:
    """Entry point."""
    asked = argparse.ArgumentParser(prog="make soak", description=__doc__)
    asked.add_argument("--minutes", type=float, default=30.0)
    asked.add_argument("--clients", type=int, default=10)
    asked.add_argument("--round", type=float, default=20.0, help="seconds between two looks")
    asked.add_argument("--light", action="store_true", help="jobs that compute nothing")
    given = asked.parse_args()
    light = running_service(STRIDELAB_API_TOKEN=ADMIN)  # the tests' worker, and the real web server's logins
    with light if given.light else real_service() as service:
        os.nice(NICENESS)
        task = LIGHT if given.light else TASK
        soak = Soak(service, users(service.port, 2), task, 60 * given.minutes, given.round, given.clients)
        began = time.monotonic()
        soak.run()
        minutes = (time.monotonic() - began) / 60
        sys.stdout.write(
            f"{soak.table()}\n\n{len(soak.accepted)} jobs in {minutes:.1f} min, each ended once; "
            f"load {os.getloadavg()[0]:.1f} at the end.\n"
        )
        sys.stdout.flush()
    if faults := soak.faults():
        raise SystemExit("\n".join(faults))


if __name__ == "__main__":
    main()
