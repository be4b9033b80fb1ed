"""Write models/reachability/<robot>.json: the densities that every installation brings with it.

Usage: make_reachability.py ROBOT [FOLDER]
"""

import sys
from pathlib import Path

from threadpoolctl import threadpool_limits

from stridelab.reachability.learning import learn
from stridelab.reachability.store import save
from stridelab.resources import models_dir
from stridelab.robots.loader import load_robot


def make_reachability(robot_name: str, folder: Path) -> None:
    """Learn from 20 000 uniform postures, as the thesis does, with seed 0."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = load_robot(robot_name)
    with threadpool_limits(1):  # the arrays are small: more threads mostly wait for each other
        save(folder / f"{robot_name}.json", learn(robot).card)


if __name__ == "__main__":
    make_reachability(sys.argv[1], Path(sys.argv[2]) if len(sys.argv) > 2 else models_dir() / "reachability")
