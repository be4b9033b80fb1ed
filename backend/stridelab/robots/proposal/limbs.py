"""Legs, arms and torso of a humanoid, from the tree of its joints and its symmetry.

A limb is a branch of the tree with a mirror image beside it: as many joints, and about the same mass and length. The
legs are the heaviest and longest pair. Up is opposite to them; left is where the names of the joints say so.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Rotation, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.robots.assembly import round_to_axes

LEG_JOINTS: Final = 6
"""Joints that a leg needs to place a sole in position and orientation."""
ARM_JOINTS: Final = 3
SIMILAR: Final = 0.15
"""Relative difference of mass and length within which two branches are mirror images."""
MIN_LIMB_SHARE: Final = 0.01
"""Minimum share of a limb in the robot's mass."""
FINGER_SHARE: Final = 0.004
"""Branches of a hand below this share of the robot's mass are fingers, which are locked."""
MAIN_SHARE: Final = 0.8
"""Minimum share of the branch in which a limb goes on."""

Chain = tuple[int, ...]


@dataclass(frozen=True)
class Limbs:
    """Joint ids of the limbs from the trunk outwards, left before right; ``arms`` may be empty.

    The columns of ``R_root`` are the forward, left and up axes in the root link at the neutral configuration;
    ``is_named`` tells whether the names of the joints define left and right.
    """

    legs: tuple[Chain, Chain]
    arms: tuple[Chain, Chain] | tuple[()]
    torso: Chain
    pelvis: int
    R_root: Rotation
    is_named: bool

    @property
    def moving(self) -> frozenset[int]:
        """All joints that move; the others are locked."""
        return frozenset((*self.legs[0], *self.legs[1], *self.torso, *(joint for arm in self.arms for joint in arm)))


@dataclass(frozen=True)
class _Branch:
    """A branch of the tree: its first joint, its main chain, mass, and the length of its main chain."""

    first: int
    chain: Chain
    mass_kg: float
    length_m: float


def not_humanoid(message: str, where: str = "joints") -> InvalidInput:
    """The error for a robot that is no humanoid on two feet."""
    return InvalidInput("robot-not-humanoid", f"This robot cannot be added: {message}.", [Fault(where, message)])


def find_limbs(model: pin.Model, q: Float[np.ndarray, "nq"]) -> Limbs:
    """The limbs of the full ``model`` (floating base) at the neutral configuration ``q``.

    Raises ``InvalidInput`` (``robot-not-humanoid``) with the reason.
    """
    tree = _Tree(model, q)
    pairs = tree.mirrored_pairs()
    for pair in pairs:
        if len(pair) > 2:
            raise not_humanoid(f"it has {len(pair)} equal limbs on one body, starting at {tree.names(pair)}")
    candidates = [pair for pair in pairs if len(pair[0].chain) >= ARM_JOINTS]
    if not candidates:
        raise not_humanoid(
            f"it has no two mirror-image chains of {LEG_JOINTS} joints, which would be its legs "
            f"(mass and length equal within {100 * SIMILAR:.0f} %); its longest chain of joints ends at "
            f"{tree.longest_chain_end()!r}"
        )
    legs = max(candidates, key=lambda pair: pair[0].mass_kg * pair[0].length_m)
    lowest = min(candidates, key=lambda pair: tree.end_height_m(pair) - 1e-3 * pair[0].mass_kg)
    if tree.points_down(lowest):  # the convention of descriptions: z is up
        legs = lowest
    others = [pair for pair in candidates if pair is not legs]
    if (n := len(legs[0].chain)) < LEG_JOINTS:
        raise not_humanoid(f"its legs have {n} joints; a sole needs {LEG_JOINTS} ({tree.names(legs)})")
    reach = tree.mean_end(legs) - tree.mean_start(legs)
    for pair in others:
        at = tree.mean_end(pair) - tree.mean_start(pair)
        if pair[0].mass_kg > 0.5 * legs[0].mass_kg and np.linalg.norm(at - reach) < 0.15 * np.linalg.norm(reach):
            same_height = abs((tree.mean_start(pair) - tree.mean_start(legs)) @ reach) < 0.1 * (reach @ reach)
            if same_height:
                raise not_humanoid("it stands on four legs")
    chains, is_named = tree.left_first(legs)
    arms: tuple[Chain, Chain] | tuple[()] = ()
    torso: Chain = ()
    pelvis = int(model.parents[chains[0][0]])
    if others:
        pair = max(others, key=lambda pair: pair[0].mass_kg * pair[0].length_m)
        shoulders = int(model.parents[pair[0].first])
        # Joints between the root and the legs are locked: each leg moves by its own joints alone.
        torso = tuple(sorted(set(model.supports[shoulders]) - set(model.supports[pelvis])))
        ordered, _ = tree.left_first(pair)
        arms = ordered if is_named else tree.like_legs(ordered, chains)
    R = tree.axes(chains, reach)
    return Limbs(chains, arms, torso, pelvis, R, is_named)


class _Tree:
    """The joint tree with masses, lengths and positions (in the root link)."""

    def __init__(self, model: pin.Model, q: Float[np.ndarray, "nq"]) -> None:
        self.model = model
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        root = data.oMi[1].inverse()
        self.at = [np.array((root * placement).translation) for placement in data.oMi]
        n = model.njoints
        self.children: list[list[int]] = [[] for _ in range(n)]
        self.mass = np.array([inertia.mass for inertia in model.inertias])
        for joint in range(n - 1, 1, -1):
            self.children[int(model.parents[joint])].append(joint)
            self.mass[int(model.parents[joint])] += self.mass[joint]
        self.total_kg = float(self.mass[1])

    def mirrored_pairs(self) -> list[list[_Branch]]:
        """Groups of similar branches on one body, none of them inside a branch of another group."""
        groups: list[list[_Branch]] = []
        open_joints = [1]
        while open_joints:
            joint = open_joints.pop(0)
            heavy = [c for c in self.children[joint] if self.mass[c] > MIN_LIMB_SHARE * self.total_kg]
            by_size: dict[int, list[_Branch]] = defaultdict(list)
            for branch in map(self._branch, heavy):
                by_size[len(branch.chain)].append(branch)
            taken: set[int] = set()
            for branches in by_size.values():
                for branch in branches:
                    if branch.first in taken:
                        continue
                    group = [other for other in branches if other.first not in taken and _is_similar(branch, other)]
                    if len(group) > 1:
                        groups.append(group)
                        taken |= {other.first for other in group}
            open_joints += [child for child in heavy if child not in taken]
        return groups

    def _branch(self, first: int) -> _Branch:
        chain = [first]
        while children := self.children[chain[-1]]:
            heaviest = max(children, key=lambda child: self.mass[child])
            share = self.mass[heaviest] / sum(self.mass[child] for child in children)
            if share < MAIN_SHARE or self.mass[heaviest] < FINGER_SHARE * self.total_kg:
                break
            chain.append(heaviest)
        steps = np.diff([self.at[joint] for joint in chain], axis=0).reshape(-1, 3)
        return _Branch(first, tuple(chain), float(self.mass[first]), float(np.linalg.norm(steps, axis=1).sum()))

    def names(self, pair: Sequence[_Branch]) -> str:
        return ", ".join(repr(self.model.names[branch.first]) for branch in pair[:4])

    def longest_chain_end(self) -> str:
        """Name of the joint with the most joints above it; of several the first."""
        depths = [len(self.model.supports[joint]) for joint in range(self.model.njoints)]
        return str(self.model.names[int(np.argmax(depths))])

    def mean_start(self, pair: Sequence[_Branch]) -> Vector3:
        return np.asarray(np.mean([self.at[branch.first] for branch in pair], axis=0))

    def mean_end(self, pair: Sequence[_Branch]) -> Vector3:
        return np.asarray(np.mean([self.at[branch.chain[-1]] for branch in pair], axis=0))

    def end_height_m(self, pair: Sequence[_Branch]) -> float:
        return float(self.mean_end(pair)[2])

    def points_down(self, pair: Sequence[_Branch]) -> bool:
        reach = self.mean_end(pair) - self.mean_start(pair)
        return bool(-reach[2] > 0.85 * np.linalg.norm(reach)) and len(pair[0].chain) >= LEG_JOINTS

    def left_first(self, pair: Sequence[_Branch]) -> tuple[tuple[Chain, Chain], bool]:
        """Chains of a pair, left first if the names say which is left."""
        a, b = pair[0].chain, pair[1].chain
        votes = 0
        for one, other in zip(a, b, strict=True):
            names = self.model.names[one].lower(), self.model.names[other].lower()
            letters = next(((x, y) for x, y in zip(*names, strict=False) if x != y), ("", ""))
            votes += {("l", "r"): 1, ("r", "l"): -1}.get(letters, 0)
        return ((b, a) if votes < 0 else (a, b)), votes != 0

    def like_legs(self, arms: tuple[Chain, Chain], legs: tuple[Chain, Chain]) -> tuple[Chain, Chain]:
        """The arms in the order of the legs: the first of both on the same side."""
        side = self.at[legs[0][0]] - self.at[legs[1][0]]
        across = self.at[arms[0][0]] - self.at[arms[1][0]]
        return arms if side @ across > 0.0 else (arms[1], arms[0])

    def axes(self, legs: tuple[Chain, Chain], reach: Vector3) -> Rotation:
        """Forward, left and up axes in the root link, rounded to its own axes."""
        up = -reach / np.linalg.norm(reach)
        left = self.at[legs[0][-1]] - self.at[legs[1][-1]]
        left -= (left @ up) * up
        if np.linalg.norm(left) < 1e-3:
            raise not_humanoid("its feet are not beside each other with all joints at 0")
        left /= np.linalg.norm(left)
        return round_to_axes(np.column_stack([np.cross(left, up), left, up]))


def _is_similar(a: _Branch, b: _Branch) -> bool:
    return a is b or (
        abs(a.mass_kg - b.mass_kg) <= SIMILAR * max(a.mass_kg, b.mass_kg)
        and abs(a.length_m - b.length_m) <= SIMILAR * max(a.length_m, b.length_m)
    )
