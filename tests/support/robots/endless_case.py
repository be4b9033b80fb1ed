"""A case of the grid that notes its process and never comes to an end. Run as a program, it does only that."""

import os
import time
from pathlib import Path
from typing import Any

from experiments.climbing_grid import Case, run_grid
from stridelab.robots.loader import load_robot


class Endless(dict[str, Any]):
    """A scenario that never answers."""

    def get(self, *_: object) -> Any:
        Path(os.environ["NOTED"], str(os.getpid())).touch()
        time.sleep(600)


if __name__ == "__main__":
    run_grid(load_robot("talos"), {}, [Case("endless", "stairs", Endless())], processes=1)
