"""Which pairs of links need no check: the table ``[collision.never]`` of a robot's card, found by trying.

    .venv/bin/python scripts/find_collision_pairs.py g1

All pairs of links that do not hang on the same joint are checked in the reference posture and in random configurations
(uniform within the joint limits, 5000 of seed 0), with the card's shapes (mostly convex hulls) and with the meshes as
they are. Of no use are those that

  are joined by one joint                 their shapes overlap by construction, and the joint's range keeps them apart
  touch at rest                           the card's shapes do in the reference posture: the hulls are too wide there
  touch nearly always                     the card's shapes do in over 95 % of the configurations: the same
  never touch                             the meshes do not: what lies between keeps them apart

The table goes to the standard output, what was counted to the standard error. A card that has a table is tried as if
it had none.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Final

import numpy as np

from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

CONFIGURATIONS: Final = 5_000
SEED: Final = 0
ALWAYS: Final = 0.95

Pair = tuple[str, str]


def main() -> None:
    """Try, sort and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=robot_names())
    name = parser.parse_args().robot
    hulls = without_table(name, {}, robot_card(name).collision.meshes)
    touching, at_rest = shares(hulls), set(SelfCollision(hulls).colliding_links(hulls.q_reference))
    pairs_by_reason = {
        "are joined by one joint": list(joined(hulls, list(touching))),
        "touch at rest": sorted(at_rest),
        "touch nearly always": [pair for pair, share in touching.items() if share > ALWAYS],
    }
    overlapping: dict[str, tuple[str, ...]] = {}
    for link, other in chain.from_iterable(pairs_by_reason.values()):
        overlapping[link] = (*overlapping.get(link, ()), other)
    meeting = shares(without_table(name, overlapping, (".*",)))
    pairs_by_reason["never touch"] = [pair for pair, share in meeting.items() if share == 0.0]
    table: dict[str, list[str]] = defaultdict(list)
    listed: set[Pair] = set()
    for reason, pairs in pairs_by_reason.items():
        new = [pair for pair in pairs if pair not in listed]
        listed.update(new)
        sys.stderr.write(f"{len(new):4d} of {len(touching)} pairs of links {reason}\n")
        for link, other in new:
            table[link].append(other)
    sys.stdout.write("[collision.never]\n")
    for link, others in table.items():
        sys.stdout.write(f"{link} = {json.dumps(others)}\n")


def without_table(name: str, never: dict[str, tuple[str, ...]], meshes: tuple[str, ...]) -> Robot:
    """The robot with another table, and with the ``meshes`` as they are."""
    card = robot_card(name)
    return assemble_robot(
        "tried", replace(card, collision=replace(card.collision, never=never, meshes=meshes)), data_files(card)
    )


def shares(robot: Robot) -> dict[Pair, float]:
    """Share of the configurations in which two links touch, whichever of their shapes."""
    rng, check = np.random.default_rng(SEED), SelfCollision(robot)
    low, high = robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:]
    names = [str(robot.model.frames[part.parentFrame].name) for part in robot.collision.geometryObjects]
    count = dict.fromkeys(((names[pair.first], names[pair.second]) for pair in robot.collision.collisionPairs), 0)
    q = robot.q_reference.copy()
    for _ in range(CONFIGURATIONS):
        q[7:] = rng.uniform(low, high)
        for links in set(check.colliding_links(q)):
            count[links] += 1
    return {links: times / CONFIGURATIONS for links, times in count.items()}


def joined(robot: Robot, pairs: list[Pair]) -> Iterator[Pair]:
    """Pairs of which one hangs on the joint that the other carries."""
    model = robot.model
    for pair in pairs:
        a, b = (model.frames[model.getFrameId(name)].parentJoint for name in pair)
        if model.parents[a] == b or model.parents[b] == a:
            yield pair


if __name__ == "__main__":
    main()
