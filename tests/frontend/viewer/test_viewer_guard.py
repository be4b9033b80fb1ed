"""Nobody but the web app gets into a viser server, and nothing asks for a tunnel to the outside."""

import asyncio
from collections.abc import Iterator

import pytest
import viser
import websockets
from viser import _messages

from stridelab_web.viewer.access_guard import start_guarded_server

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def guarded() -> Iterator[tuple[viser.ViserServer, str]]:
    server, secret = start_guarded_server()
    yield server, secret
    server.stop()


def first_message(port: int, path: str, **options: object) -> bytes:
    async def talk() -> bytes:
        address = f"ws://127.0.0.1:{port}/{path}"
        protocols = [websockets.Subprotocol(PROTOCOL)]
        async with websockets.connect(address, subprotocols=protocols, proxy=None, **options) as socket:
            assert socket.subprotocol == PROTOCOL
            message = await socket.recv()
            assert isinstance(message, bytes)
            return message

    return asyncio.run(talk())


def test_the_secret_path_leads_to_the_scene(guarded: tuple[viser.ViserServer, str]) -> None:
    server, secret = guarded
    assert first_message(server.get_port(), secret)


@pytest.mark.parametrize("path", ["", "wrong", "view", "%00"])
def test_other_paths_are_refused(guarded: tuple[viser.ViserServer, str], path: str) -> None:
    with pytest.raises(websockets.InvalidStatus) as refusal:
        first_message(guarded[0].get_port(), path)
    assert refusal.value.response.status_code == 403


def test_a_page_of_any_site_is_refused_even_with_the_secret(guarded: tuple[viser.ViserServer, str]) -> None:
    server, secret = guarded
    with pytest.raises(websockets.InvalidStatus):
        first_message(server.get_port(), secret, origin="http://127.0.0.1:8000")


def test_share_requests_have_no_handler(guarded: tuple[viser.ViserServer, str]) -> None:
    handled = guarded[0]._websock_server._incoming_handlers
    assert handled, "viser keeps its handlers elsewhere now"
    assert not {_messages.ShareUrlRequest, _messages.ShareUrlDisconnect} & set(handled)


def test_a_server_started_later_is_not_guarded_by_accident() -> None:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        assert first_message(server.get_port(), "")
    finally:
        server.stop()
