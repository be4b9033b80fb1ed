"""Bundled scenes for any robot: ``POST /scenarios/scaled`` and ``stridelab plan SCENE --robot``."""

from stridelab.contacts.scenarios.hand_scenes import ArmReach
from stridelab.contacts.scenarios.parts import Walker
from stridelab.contacts.scenarios.robot_scenes import HAND_SCENES, SCENES, scaled_scene
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.robots import WalkerFacts
from stridelab.schemas.scenarios import Scenario


def scene_for_robot(scene: str, robot: str, facts: WalkerFacts | None) -> Scenario:
    """The bundled ``scene`` scaled to ``robot``.

    Raises ``InvalidInput``: ``scene-not-scalable`` for a scene that is not one of ``SCENES`` and ``HAND_SCENES``,
    ``robot-not-scalable`` for a robot whose legs, or arms for a scene of a hand, are not known.
    """
    if scene not in SCENES and scene not in HAND_SCENES:
        known = ", ".join((*SCENES, *HAND_SCENES))
        message = f"The scene {scene[:60]!r} cannot be scaled to a robot; these can: {known}."
        raise InvalidInput("scene-not-scalable", message, [Fault("scene", "not one of them")])
    if facts is None:
        message = (
            f"Scenes cannot be scaled to {robot}: it does not stand on two soles at the ends of legs, or it was added "
            "with an earlier version. In that case save its card again."
        )
        raise InvalidInput("robot-not-scalable", message, [Fault("robot", "the length of its legs is not known")])
    walker = Walker(robot, facts.foot_y_m, facts.toe_m, facts.heel_m)
    arm = None
    if scene in HAND_SCENES:
        if facts.shoulder_m is None or facts.arm_m is None:
            message = (
                f"The scene {scene!r} needs a hand, and {robot} has no arm of at least four joints, or was added with "
                "an earlier version. In that case save its card again."
            )
            raise InvalidInput("robot-not-scalable", message, [Fault("robot", "the length of its arm is not known")])
        arm = ArmReach(facts.shoulder_m, facts.arm_m)
    return Scenario.model_validate(scaled_scene(scene, walker, facts.leg_m, arm))
