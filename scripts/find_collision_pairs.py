"""Which pairs of links need no check: the table ``[collision.never]`` of a robot's card, found by trying.

    .venv/bin/python scripts/find_collision_pairs.py g1

All pairs of shapes that do not hang on the same joint are checked in random configurations (uniform within the joint
limits, 20000 of seed 0) and in the reference posture. Of no use are those that

  touch in the reference posture   the shapes overlap by construction (a motor in its housing), or their hulls do
  touch in over 95 % of all        the same
  never touch                      what lies between keeps them apart

The table goes to the standard output, what was counted to the standard error. A card that has a table is tried as if
it had none.
"""

import argparse
import json
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np

from stridelab.robots.assembly import assemble
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.collision import SelfCollision
from stridelab.robots.data_files import data_files
from stridelab.robots.robot import Robot

CONFIGURATIONS, SEED, ALWAYS = 3_000, 0, 0.95


def main() -> None:
    """Try, sort and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=robot_names())
    card = robot_card(parser.parse_args().robot)
    robot = assemble("tried", replace(card, collision=replace(card.collision, never={})), data_files(card))
    touched = shares(robot)
    at_rest = set(SelfCollision.of(robot).pairs(robot.q_reference))
    reasons = {
        "touch in the reference posture": sorted(at_rest),
        "touch nearly always": sorted(p for p, share in touched.items() if share > ALWAYS and p not in at_rest),
        "never touch": sorted(p for p, share in touched.items() if share == 0.0 and p not in at_rest),
    }
    table: dict[str, list[str]] = defaultdict(list)
    for reason, found in reasons.items():
        sys.stderr.write(f"{len(found):4d} of {len(touched)} pairs of links {reason}\n")
        for link, other in found:
            table[link].append(other)
    sys.stdout.write("[collision.never]\n")
    for link, others in table.items():
        sys.stdout.write(f"{link} = {json.dumps(others)}\n")


def shares(robot: Robot) -> dict[tuple[str, str], float]:
    """Share of the configurations in which two links touch, whichever of their shapes."""
    rng, check = np.random.default_rng(SEED), SelfCollision.of(robot)
    low, high = robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:]
    names = [str(robot.model.frames[part.parentFrame].name) for part in robot.collision.geometryObjects]
    count = dict.fromkeys(((names[pair.first], names[pair.second]) for pair in robot.collision.collisionPairs), 0)
    q = robot.q_reference.copy()
    for _ in range(CONFIGURATIONS):
        q[7:] = rng.uniform(low, high)
        for links in set(check.pairs(q)):
            count[links] += 1
    return {links: times / CONFIGURATIONS for links, times in count.items()}


if __name__ == "__main__":
    main()
