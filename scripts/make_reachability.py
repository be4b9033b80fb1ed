"""Write models/reachability/<robot>/<measure>.{json,npz}: the densities that every installation brings with it.

Usage: make_reachability.py ROBOT MEASURE [--samples N] [--seed N] [--date YYYY-MM-DD] [--processes N] [--folder FOLDER]

The same robot, measure, samples, seed, date and versions give the same bytes, however many processes there are.
"""

import argparse
from datetime import UTC, date, datetime
from pathlib import Path
from typing import get_args

from stridelab.machine.models_folder import models_dir
from stridelab.reachability.card import Measure
from stridelab.reachability.learning.fit import learn_densities
from stridelab.reachability.store import save_card, save_cloud
from stridelab.robots.card import robot_names
from stridelab.robots.loader import load_robot


def main() -> None:
    """Learn from 20 000 postures, as the thesis does, with seed 0, unless told otherwise."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=robot_names())
    parser.add_argument("measure", choices=get_args(Measure))
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--date", type=date.fromisoformat, default=datetime.now(UTC).date())
    parser.add_argument("--processes", type=int, default=None)
    parser.add_argument("--folder", type=Path, default=models_dir() / "reachability")
    arguments = parser.parse_args()
    learned = learn_densities(
        load_robot(arguments.robot),
        arguments.date,
        samples=arguments.samples,
        seed=arguments.seed,
        measure=arguments.measure,
        processes=arguments.processes,
    )
    folder = arguments.folder / arguments.robot
    folder.mkdir(parents=True, exist_ok=True)
    save_card(folder / f"{arguments.measure}.json", learned.card)
    save_cloud(folder / f"{arguments.measure}.npz", learned.cloud.com_m)


if __name__ == "__main__":
    main()
