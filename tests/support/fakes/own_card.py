"""The card of one's own robot, as the pages see it: the robot of boxes, which a user has uploaded."""

from datetime import UTC, datetime

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.schemas.robots import EarlierCard, OwnRobot, RobotFacts
from support.fakes import robots


def own_robot() -> OwnRobot:
    """The robot of boxes as one of a user, with soles below its feet, a right hand, and a knee that is too weak.

    As in a proposed card, fields with their defaults are left out: orientations here, and the position of the hand.
    """
    feet = {
        f"{side}_foot": {
            "frame": f"leg_{side}_6_link", "kind": "surface", "position_m": [0.0, 0.0, -0.05],
            "contact_half_size_m": list(robots.HALF_M),
        }
        for side in ("left", "right")
    }  # fmt: skip
    hand = {"frame": "arm_right_7_link", "kind": "point"}
    weak = {"limits.torque_nm.knee": "40 N m as stated, which is implausible; the estimate is 90 N m"}
    return OwnRobot(
        name="boxes", state="proposed", owner=None, filename="boxes.zip", sha256="0" * 64, robot_sha256="1" * 64,
        card={"title": "Boxes", "effectors": {**feet, "right_hand": hand}, "limits": {"torque_nm": {"knee": 40.0}}},
        assumed=list(weak), assumptions=weak, estimates={"limits.torque_nm.knee": 90.0}, created_at=datetime.now(UTC),
    )  # fmt: skip


async def send_links(_: Request) -> Response:
    """``GET /robots/{name}/links``: the shapes of the robot of boxes."""
    return Response(robots.links_glb(), media_type="model/gltf-binary")


class OwnCard:
    """``GET`` and ``PUT /robots/{name}/card``; there is no card before a test sets ``own``."""

    def __init__(self) -> None:
        self.own: OwnRobot | None = None

    def mark_facts(self, facts: RobotFacts) -> RobotFacts:
        """The facts of the robot, which is the user's own while it has a card."""
        return facts.model_copy(update={"own": self.own is not None})

    async def answer(self, request: Request) -> Response:
        """The card, after a change of it is kept."""
        if self.own is None:
            return JSONResponse({"title": "Not Found", "detail": "No card.", "code": "robot-not-found"}, 404)
        if request.method == "PUT":
            own = self.own
            replaced = EarlierCard(
                version=own.version, card=own.card, assumptions=own.assumptions, replaced_at=datetime.now(UTC)
            )
            new = {"card": await request.json(), "version": own.version + 1, "earlier": [*own.earlier, replaced]}
            self.own = own.model_copy(update=new)
        return JSONResponse(self.own.model_dump(mode="json"))
