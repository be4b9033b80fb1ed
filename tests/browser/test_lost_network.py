"""The network is lost in the middle of something: the page says so once, keeps what it shows, and goes on by itself."""

import contextlib
import gc
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Locator, Page, WebSocketRoute, expect

from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.streams import MarkerFrame, MarkerStreamConfiguration
from stridelab.service.samples.scenario_bodies import ONE_STEP
from support.browser.network import Network, network_to
from support.browser.page import TWO_PICTURES, Service, Tab, until
from support.browser.service_costs import Meter, metered
from support.service.streams import frame, header

NOTICED_WITHIN_MS = 20_000
BACK_WITHIN_MS = 30_000


@pytest.fixture
def network(service: Service) -> Iterator[Network]:
    with network_to(int(urlsplit(service.url).port or 0)) as between:
        yield between


@pytest.fixture
def tab(open_tab: Callable[..., Tab], network: Network) -> Iterator[Tab]:
    """A tab behind that network; the browser's own word on a lost request is no misstep."""
    made = open_tab()
    made.url = network.url
    yield made
    made.page.close()  # before the network ends
    made.missteps = [m for m in made.missteps if not re.search("net::ERR|WebSocket connection", m)]


def connection_notice(page: Page) -> Locator:
    return page.get_by_role("complementary", name="Connection")


def expect_lost(page: Page) -> None:
    expect(connection_notice(page)).to_contain_text("The service does not answer.", timeout=NOTICED_WITHIN_MS)
    assert page.get_by_text("does not answer").count() == 1, "it is said once"


def expect_back(page: Page) -> None:
    expect(connection_notice(page)).to_contain_text("The service answers again.", timeout=BACK_WITHIN_MS)
    expect(connection_notice(page)).to_be_hidden()


def shown_s(page: Page, part: str) -> float:
    return float(page.locator(part).get_attribute("data-shown") or "nan")


@pytest.mark.parametrize("way", ["silence", "cut"])
def test_a_live_robot_says_that_the_network_is_lost(tab: Tab, service: Service, network: Network, way: str) -> None:
    """Nothing ends the websocket of a radio link that is lost: the page notices that no frame comes."""
    session = service.client.start_live(robot="talos")
    page, robot, push = tab.go(session.page), "[data-live-robot]", tab.page.locator("[data-push=ahead]")
    expect(page.locator(robot)).to_have_attribute("data-shown", re.compile(r"[1-9]"), timeout=120_000)
    expect(push).to_be_enabled()
    getattr(network, way)()
    expect_lost(page)
    expect(push).to_be_disabled()
    page.evaluate(TWO_PICTURES)
    stopped_s = shown_s(page, robot)
    page.wait_for_timeout(500)
    assert shown_s(page, robot) == stopped_s
    network.restore()
    expect_back(page)
    until(page, lambda: shown_s(page, robot) > stopped_s + 0.5)
    expect(push).to_be_enabled()
    service.client.end_live(session.session_id)
    expect(page.locator("[data-said]")).to_have_text("This robot is no longer live. Start a new one.")


def test_a_live_robot_goes_on_once_the_reader_has_logged_in_again(tab: Tab, service: Service) -> None:
    """A lost socket is refused to an ended token; the page does not try it again before the next login."""
    session, has_ended, tried = service.client.start_live(robot="talos"), False, []
    page, robot = tab.page, "[data-live-robot]"

    def connect(socket: WebSocketRoute) -> None:
        tried.append(socket)
        if has_ended:
            socket.close(code=4401)
        else:
            socket.connect_to_server()

    page.route_web_socket("**/api/v1/live/*", connect)
    tab.go(session.page)
    expect(page.locator(robot)).to_have_attribute("data-shown", re.compile(r"[1-9]"), timeout=120_000)
    has_ended = True
    page.route("**/api/v1/caller", lambda route: route.fulfill(status=401, body="{}"))
    tried[0].close(code=4000)
    expect(connection_notice(page)).to_contain_text("Your login has ended.", timeout=NOTICED_WITHIN_MS)
    expect(page.locator("[data-said]")).to_be_empty()
    expect(page.locator("[data-push=ahead]")).to_be_disabled()
    page.evaluate(TWO_PICTURES)
    n_tried, stopped_s = len(tried), shown_s(page, robot)
    page.wait_for_timeout(2500)  # longer than the page waits where only the connection is lost
    assert len(tried) == n_tried
    has_ended = False
    page.unroute("**/api/v1/caller")
    page.evaluate("() => window.dispatchEvent(new Event('focus'))")
    until(page, lambda: shown_s(page, robot) > stopped_s + 0.5)
    expect(page.locator("[data-push=ahead]")).to_be_enabled()
    tab.missteps = [m for m in tab.missteps if "status of 401" not in m]
    service.client.end_live(session.session_id)


@pytest.mark.parametrize("way", ["silence", "cut"])
def test_a_live_walk_says_that_the_network_is_lost(tab: Tab, service: Service, network: Network, way: str) -> None:
    """The sender is elsewhere, and sends on."""
    page, body, said = tab.go("/live"), "[data-body]", tab.page.locator("[data-said]")
    with service.client.stream_markers(MarkerStreamConfiguration.model_validate(header(title="Lane 3"))) as stream:

        def send(first: int, last: int) -> None:
            for k in range(first, last):
                stream.send(MarkerFrame.model_validate(frame(k)))

        expect(said).to_contain_text("Lane 3")
        send(0, 60)
        expect(page.locator(body)).to_have_attribute("data-shown", re.compile(r"^0\.[0-9]+$"))
        getattr(network, way)()
        expect_lost(page)
        expect(said).to_contain_text("Lane 3")
        send(60, 90)
        network.restore()
        expect_back(page)
        until(page, lambda: any(one.n_watching for one in service.client.marker_streams().items))
        send(90, 120)
        until(page, lambda: shown_s(page, body) > 0.9)
        expect(said).to_contain_text("Lane 3: 100 frames per second")


def test_a_job_is_followed_through_a_silent_network(tab: Tab, service: Service, network: Network) -> None:
    job = service.client.submit("simulate-recording", {"duration_s": 20.0, "seed": 5})
    page = tab.go(f"/jobs/{job.id}")
    network.silence()
    service.client.wait(job.id, 120.0)
    expect_lost(page)
    network.restore()
    expect(page.locator("[data-state]").first).to_have_text("succeeded", timeout=BACK_WITHIN_MS)


def test_an_edit_is_stored_once_the_network_is_back(tab: Tab, service: Service, network: Network) -> None:
    scenario = service.client.add_scenario(Scenario.model_validate(ONE_STEP))
    page = tab.go(f"/view/?scenario={scenario.id}&phase=1")
    page.wait_for_selector("[data-ready]", timeout=90_000)
    verdict, said = page.locator("[data-verdict]"), page.locator("[data-said]").first
    expect(verdict).to_contain_text("Valid", timeout=60_000)
    network.cut()
    lasts_s = scenario.phases[1].duration_s + 0.3
    page.get_by_label("lasts").fill(f"{lasts_s:.2f}")
    page.locator("h1").click()  # which leaves the field, and so stores
    expect_lost(page)
    expect(said).to_have_text("Not stored yet: it will be once the service answers.")
    expect(verdict).to_contain_text("Valid")
    assert service.client.scenario(scenario.id).phases == scenario.phases
    network.restore()
    expect_back(page)
    expect(said).to_have_text("Phase 1 stored.")
    assert abs(service.client.scenario(scenario.id).phases[1].duration_s - lasts_s) < 1e-6
    service.client.delete_scenario(scenario.id)


@pytest.mark.parametrize("proxy", [network_to, metered])
def test_no_connection_is_left_open_when_the_network_ends(
    proxy: Callable[[int], contextlib.AbstractContextManager[Network | Meter]],
) -> None:
    """A connection that is garbage while it is open is an error in a test that has nothing to do with it."""
    is_open = True

    def answer_at_length(listening: socket.socket) -> None:
        while is_open:
            with contextlib.suppress(OSError), listening.accept()[0] as accepted:
                accepted.sendall(bytes(20_000_000))

    def connect_again_and_again(port: int) -> None:
        while is_open:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1) as client:
                client.sendall(b"GET")

    with socket.create_server(("127.0.0.1", 0)) as listening, contextlib.ExitStack() as ended:
        with proxy(listening.getsockname()[1]) as between:
            port = int(urlsplit(between.url).port or 0)
            reads_nothing = ended.enter_context(socket.create_connection(("127.0.0.1", port)))
            threads = [threading.Thread(target=answer_at_length, args=(listening,))]
            threads += [threading.Thread(target=connect_again_and_again, args=(port,)) for _ in range(3)]
            for thread in threads:
                thread.start()
            assert reads_nothing.recv(1) == bytes(1)
            time.sleep(0.3)  # until more is on its way than the sockets between them hold
        is_open = False
        listening.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join()
    gc.collect()
