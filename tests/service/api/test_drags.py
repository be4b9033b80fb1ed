"""A drag in the 3D view is stored with the right of the person who drags: scope, owner, revocation, audit."""

import asyncio
import time
from collections.abc import Iterator
from typing import Any, Literal

import msgspec
import pytest
import viser
import websockets
from viser import _messages

from stridelab.service.api.session_cookies import SESSION_S, SigningKeys
from support.browser.service_costs import ADMIN, Lab, viewer_lab
from support.robots.scenario_bodies import one_step
from support.service.database import TestDatabases

SCENARIOS = "/api/v1/scenarios"
MARK = 1
"""Number of the touch that is dragged."""


@pytest.fixture(scope="module")
def lab(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with viewer_lab(postgres, tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture(scope="module")
def owner(lab: Lab) -> dict[str, Any]:
    return lab.token("owner", "submit")


def stored_by(lab: Lab, secret: str) -> dict[str, Any]:
    with lab.http(secret) as http:
        answer = http.post(SCENARIOS, json=one_step(), timeout=120)
        assert answer.status_code == 201, answer.text
        return dict(answer.json())


def drag(lab: Lab, secret: str, scenario: dict[str, Any], by_m: float) -> str:
    """Drag a mark along x as viser's client does, and return the message to the page."""
    x, y, z = scenario["phases"][0]["contacts"][MARK - 1]["position_m"]
    address = f"/view/scene/scenario/{scenario['id']}/-"
    camera = _messages.ViewerCameraMessage(
        (1.0, 0.0, 0.0, 0.0), (x, y, z + 2.0), 1.0, 0.01, 1000.0, 480, 640, (x, y, z), (0.0, 1.0, 0.0)
    )

    def moved(phase: Literal["start", "update", "end"], to_m: float) -> bytes:
        start, end = (x, y, z), (x + to_m, y, z)
        return packed(
            _messages.SceneNodeDragMessage(
                phase, f"/contacts/{MARK}", None, start, (0.5, 0.5), end, (0.5, 0.5), "left", None
            )
        )

    async def talk() -> None:
        async with websockets.connect(
            lab.served.base_url.replace("http", "ws") + address,
            subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
            additional_headers={"Authorization": f"Bearer {secret}"},
            max_size=None,
            proxy=None,
        ) as page:
            await page.recv()
            await page.send(packed(camera))
            await asyncio.sleep(0.5)  # viser makes its client from the first camera, in a thread
            await page.send(moved("start", 0.0))
            await page.send(moved("update", by_m / 2))
            await page.send(moved("end", by_m))
            await asyncio.sleep(2.0)

    asyncio.run(talk())
    with lab.http(secret) as http:
        answer = http.post(f"{address}/open", timeout=120)
        assert answer.status_code == 200, answer.text
        return str(answer.json()["said"])


def packed(message: _messages.Message) -> bytes:
    """A message as viser's client sends it."""
    return msgspec.msgpack.encode(message.as_serializable_dict())


def test_an_owners_drag_is_stored_in_the_owners_name(lab: Lab, owner: dict[str, Any]) -> None:
    mine = stored_by(lab, owner["secret"])
    assert drag(lab, owner["secret"], mine, 0.02) == ""
    now = lab.admin.get(f"{SCENARIOS}/{mine['id']}").json()
    x, y, z = mine["phases"][0]["contacts"][MARK - 1]["position_m"]
    assert now["phases"][0]["contacts"][MARK - 1]["position_m"] == pytest.approx([x + 0.02, y, z], abs=1e-3)
    assert lab.audited(mine["id"]) == [("scenario-replaced", "owner")]


@pytest.mark.parametrize(
    ("scope", "reason"),
    [("read", "needs a token of scope 'submit'; yours has 'read'"), ("submit", "belongs to another user")],
)
def test_others_drags_change_nothing_and_say_why(lab: Lab, owner: dict[str, Any], scope: str, reason: str) -> None:
    theirs = stored_by(lab, owner["secret"])
    other = lab.token(f"other-{scope}", scope)
    assert drag(lab, other["secret"], theirs, 0.02) == ""  # it moves in that browser only, whose page stores a copy
    assert lab.admin.get(f"{SCENARIOS}/{theirs['id']}").json() == theirs
    assert lab.audited(theirs["id"]) == []
    with lab.http(other["secret"]) as http:
        refused = http.put(f"{SCENARIOS}/{theirs['id']}", json=one_step(name="Taken"))
        assert refused.status_code == 403
        lab.wait_until_prepared(theirs["robot"])
        page = http.get(f"/view/?scenario={theirs['id']}").text
    assert 'data-own="false"' in page
    assert reason in page.replace("&#39;", "'")


def test_an_admins_drag_changes_what_others_own(lab: Lab, owner: dict[str, Any]) -> None:
    theirs = stored_by(lab, owner["secret"])
    assert drag(lab, ADMIN, theirs, 0.02) == ""
    assert lab.audited(theirs["id"]) == [("scenario-replaced", "admin")]


def test_a_key_opens_one_scenario_only_and_is_revoked_with_its_token(lab: Lab, owner: dict[str, Any]) -> None:
    mine, another = (stored_by(lab, owner["secret"])["id"] for _ in range(2))
    leaver = lab.token("leaver", "submit")
    keys = SigningKeys.from_token(ADMIN)

    def put(key: str, scenario_id: str = mine, method: str = "PUT") -> int:
        with lab.http(key) as http:
            return http.request(method, f"{SCENARIOS}/{scenario_id}", json=one_step()).status_code

    key = keys.make_scenario_key(time.time(), owner["id"], mine)
    assert put(key) == 200
    assert put(key, another) == put(key, method="DELETE") == put(key, method="GET") == 401
    assert put(keys.make_scenario_key(time.time() - SESSION_S - 1, owner["id"], mine)) == 401
    assert put(key[:-1] + ("0" if key[-1] != "0" else "1")) == 401
    assert put("scenario-key.") == put("scenario-key...") == 401
    with lab.served.http(cookies={"stridelab_session": key}) as http:
        assert http.get(SCENARIOS).status_code == 401
    cookie = keys.make_cookie(time.time(), owner["id"])
    assert put(f"scenario-key.{cookie}") == 401
    foreign = keys.make_scenario_key(time.time(), leaver["id"], mine)
    assert put(foreign) == 403
    assert lab.admin.delete(f"/api/v1/tokens/{leaver['id']}").status_code == 200
    assert put(foreign) == 401
