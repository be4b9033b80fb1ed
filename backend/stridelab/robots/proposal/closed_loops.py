"""Bodies of an MJCF model that only close loops, such as the cranks and rods of a parallel ankle."""

from typing import Final

import mujoco

CLOSING: Final = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


def rods_of(model: mujoco.MjModel) -> frozenset[int]:
    """Bodies whose joints are not needed once the loops that they close are opened.

    Two chains lead from the last common body of a loop to where it is closed; one of them may be empty. The rods are
    the unbranched end of a chain, of the lighter one where both have one. A whole leg is no rod: where one chain is
    empty, something of the other must remain.
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
            rods |= min(closing, key=lambda end: float(model.body_mass[list(end)].sum()))
    return frozenset(rods)


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
