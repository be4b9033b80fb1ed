"""Bodies of an MJCF model that only close loops, such as the cranks and rods of a parallel ankle."""

from typing import Final

import mujoco
import numpy as np

CLOSING: Final = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


def rods_of(model: mujoco.MjModel) -> frozenset[int]:
    """Bodies whose joints are not needed once the loops that they close are opened.

    Two chains lead from the last common body of a loop to where it is closed; one of them may be empty. The rods are
    the unbranched end of a chain. Where both have one, it is that with a ball joint, else that without a motor,
    else the lighter one: rods hang on balls, or are driven by what they connect.
    A whole leg is no rod: where one chain is empty, something of the other must remain.
    """
    rods: set[int] = set()
    for i in range(model.neq):
        if model.eq_type[i] not in CLOSING:
            continue
        ends = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        if model.eq_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
        one, other = (_bodies_to_root(model, end) for end in ends)
        common = set(one) & set(other)
        sides = set(one) - common, set(other) - common
        unbranched = [_unbranched_end(model, chain) & side for chain, side in zip((one, other), sides, strict=True)]
        closing = [end for end, side in zip(unbranched, sides, strict=True) if end and (end < side or all(sides))]
        if common and closing:
            rods |= min(closing, key=lambda end: _unlikeness_to_rod(model, sorted(end)))
    return frozenset(rods)


def _unlikeness_to_rod(model: mujoco.MjModel, bodies: list[int]) -> tuple[bool, bool, float]:
    """Sort key of the end of a chain: whether it has no ball joint, whether it has a motor, and its mass (kg)."""
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies))
    has_ball = bool((model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_BALL)).any())
    turned = model.actuator_trnid[model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT), 0]
    return not has_ball, bool(np.isin(joints, turned).any()), float(model.body_mass[bodies].sum())


def _bodies_to_root(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and those that carry it, without the world."""
    chain = []
    while body != 0:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain


def _unbranched_end(model: mujoco.MjModel, chain: list[int]) -> set[int]:
    """The first bodies of a chain towards the root, up to one that carries mass beside them."""
    end: set[int] = set()
    for body in chain:
        carried = [k for k in range(1, model.nbody) if model.body_parentid[k] == body and k not in end]
        if end and any(float(model.body_subtreemass[k]) > 0.0 for k in carried):
            break
        end.add(body)
    return end
