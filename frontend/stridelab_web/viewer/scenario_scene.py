"""The scene of a scenario: terrain, the robot at its start, and contacts, which owners of the scenario can drag.

A dragged mark slides at once; on release the scenario is stored through the HTTP interface with the key of that user.
Without a key, as in samples, nothing moves for the other users of the scene: a frame below ``HELD``, in the client of
that user only, has the place of the dragged contact, and ``HELD_ENDED`` is added there on release; the page draws the
mark there and stores a copy. If the service refuses, the mark returns and its message is shown. Each attempt, and each
change that was stored elsewhere, moves the node ``TURN`` one metre along its x axis, which notifies the pages that
show the scene (static/js/editor/editor.js).

Overlays of a scenario's scene: the planned path of the CoM, its path after a push, and the support region.

The page shapes them with the responses of the service (static/js/editor/live_preview.js, support_overlay.js);
until then the tubes are points and the region is a small circle.
"""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from stridelab.client import ClientError, ProblemError
from stridelab.schemas.scenarios import Scenario, StoredScenario
from stridelab_web.scene.contacts import HalfSizes, PlacedContact, move_contact, placed_contacts
from stridelab_web.scene.documents import KEY_HEADER
from stridelab_web.viewer import meshes
from stridelab_web.viewer.access_guard import header_of
from stridelab_web.viewer.contact_markers import add_mark, place_mark
from stridelab_web.viewer.foothold_constraints import Guide, guide_of
from stridelab_web.viewer.initial_posture import Posed, add_standing, initial_pose, place_robot
from stridelab_web.viewer.plan_scene import (
    AMBIENT,
    BODY_M,
    COM_COLOUR,
    add_com,
    rotate_to_walk,
    sights_m,
    walk_direction,
)
from stridelab_web.viewer.scene_parts import NARROW, Colour, add_mesh, place_camera, prepare_scene
from stridelab_web.viewer.terrain import add_terrain

TURN, HELD, HELD_ENDED = "/turn", "/held", "/held/ended"
REAR = np.array([-0.42, 1.0, 0.75])
"""From behind and above, no step hides what stands on the one below."""
HEADROOM_M = 0.4
MOVED_M = 1e-4
"""A drag that ends closer to where it began changes nothing."""
StoreScenario = Callable[[str, Scenario, StoredScenario, str], StoredScenario]
"""Stores a scenario by its id if it is unchanged since the given version, for the user with this key."""


@dataclass(frozen=True)
class Grip:
    """A drag in progress: scenario, contact, guiding surface, and offset of the contact from the pointer.

    ``key`` is that of the dragging user, None without one; then ``held`` has the place of the contact.
    """

    stored: StoredScenario
    touch: PlacedContact
    guide: Guide
    offset_m: np.ndarray
    key: str | None
    held: viser.FrameHandle | None


class ScenarioScene:
    """A scenario in a server; it is updated without being built again."""

    def __init__(
        self, server: viser.ViserServer, stored: StoredScenario, sizes: HalfSizes, put: StoreScenario, posed: Posed
    ) -> None:
        self._stored, self._sizes, self._put = stored, sizes, put
        self._lock = threading.Lock()
        self._attempts = 0
        self._grips: dict[int, Grip] = {}
        self._held: dict[int, viser.FrameHandle] = {}
        self._server = server
        self.refusal = ""
        scene = server.scene
        prepare_scene(scene, AMBIENT)
        add_terrain(scene, stored)
        self._scene = scene
        self._marks: dict[int, viser.MeshHandle] = {}
        self._effectors: dict[int, str] = {}
        add_support_region(scene)
        add_live_paths(scene)
        self._turn = scene.add_frame(TURN, show_axes=False)
        self._robot = add_standing(scene, posed)
        self._show_scenario(stored)
        place_camera(server, self._sights_m(), rotate_to_walk(stored, REAR * [1, _open_side(stored), 1]), NARROW)

    def show_source(self, stored: StoredScenario) -> bool:
        """Show ``stored`` instead; False if robot or terrain differ."""
        with self._lock:
            if _static_fields(stored) != _static_fields(self._stored):
                return False
            if stored != self._stored:
                self._show_scenario(stored)
                self._notify_pages()
        return True

    def _drag_of(
        self, number: int
    ) -> Callable[[viser.SceneNodeDragEvent[viser.MeshHandle]], Coroutine[Any, Any, None]]:
        # Only coroutines see start, updates and end in their order; what takes long is left to a thread.
        async def on_drag(event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
            eye = np.array(event.client.camera.position)
            if event.phase == "start":
                self._start_drag(event.client, number, eye, np.array(event.start_position))
            grip = self._grips.get(event.client_id)
            if grip is None:
                return
            if number not in self._marks:  # somebody else has taken it away
                del self._grips[event.client_id]
                return
            to = self._drag_target(grip, eye, np.array(event.end_position))
            if to is not None:
                (grip.held or self._marks[number]).position = tuple(to)
            if event.phase == "end":
                del self._grips[event.client_id]
                if grip.held is not None:
                    event.client.scene.add_frame(HELD_ENDED, show_axes=False, position=grip.held.position)
                else:
                    await asyncio.to_thread(self.store_move, grip, np.array(self._marks[number].position))

        return on_drag

    def _start_drag(self, client: viser.ClientHandle, number: int, eye_m: np.ndarray, held_m: np.ndarray) -> None:
        stored = self._stored
        key = None if stored.bundled else header_of(self._server, client.client_id, KEY_HEADER)
        touch = placed_contacts(stored)[number - 1]
        guide = guide_of(stored, touch)
        hit = None if guide is None else guide.ray_intersection(eye_m, held_m)
        if guide is None or hit is None:
            return
        held, place_m = None, touch.contact.position_m
        if key is None:
            if client.client_id in self._held:
                self._held[client.client_id].remove()  # with the frames of the previous drag below it
            self._held[client.client_id] = client.scene.add_frame(HELD, show_axes=False)
            held = client.scene.add_frame(f"{HELD}/{number}", show_axes=False, position=place_m)
        self._grips[client.client_id] = Grip(stored, touch, guide, np.array(place_m) - hit, key, held)

    def _drag_target(self, grip: Grip, eye_m: np.ndarray, pointer_m: np.ndarray) -> np.ndarray | None:
        """Position of the dragged contact for a pointer at ``pointer_m``; None if the ray misses the surface."""
        hit = grip.guide.ray_intersection(eye_m, pointer_m)
        half_m = self._sizes.get(grip.touch.effector, (0.0, 0.0))
        here = np.array((grip.held or self._marks[grip.touch.number]).position)
        return None if hit is None else grip.guide.constrain_position(grip.touch, half_m, here, hit + grip.offset_m)

    def store_move(self, grip: Grip, position_m: np.ndarray) -> None:
        """Store the dragged contact at ``position_m``, or restore its mark and record the service's message."""
        with self._lock:
            self.refusal = ""
            assert grip.key is not None
            if float(np.linalg.norm(position_m - grip.touch.contact.position_m)) > MOVED_M:
                try:
                    to_m = [round(float(x), 4) for x in position_m]
                    stored = self._put(
                        grip.stored.id, move_contact(grip.stored, grip.touch, to_m), grip.stored, grip.key
                    )
                except ClientError as refusal:
                    self.refusal = refusal_text(refusal)
                    stored = self._stored
                self._show_scenario(stored)
            self._notify_pages()

    def _notify_pages(self) -> None:
        """Notify the pages that show the scene to reload it."""
        self._attempts += 1
        self._turn.position = (float(self._attempts), 0.0, 0.0)

    def _sights_m(self) -> np.ndarray:
        """Points ``(n, 3)`` that must be in view: the contacts, and the robot at the start."""
        walk_m = sights_m(self._stored, HEADROOM_M)
        begin = initial_pose(self._stored, self._sizes)
        if begin is None:
            return walk_m
        x, y, height = BODY_M
        room = np.array([[sx * x, sy * y, height] for sx in (-1, 1) for sy in (-1, 1)]) / [2, 2, 1]
        return np.concatenate([walk_m, begin.position_m + room])

    def _show_scenario(self, stored: StoredScenario) -> None:
        self._stored = stored
        place_robot(self._robot, initial_pose(stored, self._sizes))
        placed = placed_contacts(stored)
        for number in range(len(placed) + 1, len(self._marks) + 1):
            self._marks.pop(number).remove()
            del self._effectors[number]
        for touch in placed:
            if self._effectors.get(touch.number) == touch.effector:
                place_mark(self._marks[touch.number], touch)
            else:
                self._add_mark(touch)

    def _add_mark(self, touch: PlacedContact) -> None:
        """Add a mark for a new contact, or for one of another effector."""
        mark = add_mark(self._scene, touch, self._sizes)
        mark.on_drag("left")(self._drag_of(touch.number))
        self._marks[touch.number], self._effectors[touch.number] = mark, touch.effector


def refusal_text(refusal: ClientError) -> str:
    """Message of a refusal; the same sentence as in static/js/shared/api.js."""
    if not isinstance(refusal, ProblemError):
        return "The service does not answer. Is it still running?"
    return " ".join([refusal.detail, *(f"{item.where}: {item.message}" for item in refusal.errors)])


def _open_side(scenario: Scenario) -> float:
    """1 for the left of the walk, -1 for its right: the side without hands, and so without rails, in view."""
    c, s = walk_direction(scenario)
    placed = [(np.array(t.contact.position_m), "hand" in t.effector) for t in placed_contacts(scenario)]
    hands = [c * p[1] - s * p[0] for p, hand in placed if hand]
    feet = [c * p[1] - s * p[0] for p, hand in placed if not hand]
    return 1.0 if hands and feet and np.mean(hands) < np.mean(feet) else -1.0


def _static_fields(scenario: StoredScenario) -> object:
    """The fields of a scenario whose change requires a new scene."""
    return scenario.id, scenario.bundled, scenario.robot, scenario.terrain


PLANNED, RECOVERED, PUSH = "/live/planned", "/live/recovered", "/live/push"
RECOVERED_COLOUR: Colour = (150, 60, 160)
PUSH_COLOUR: Colour = (196, 30, 58)
RINGS, SIDES = 160, 6
"""Size of the tubes; the page resamples every path to this number of points."""
RADIUS_M, PUSH_RADIUS_M = 0.008, 0.012


def add_live_paths(scene: viser.SceneApi) -> None:
    """Add the nodes below ``/live``."""
    path_m = np.column_stack([np.zeros((RINGS, 2)), np.linspace(0.0, 1e-3, RINGS)])
    add_mesh(scene, PLANNED, meshes.tube(path_m, RADIUS_M, SIDES), COM_COLOUR)
    add_mesh(scene, RECOVERED, meshes.tube(path_m, RADIUS_M, SIDES), RECOVERED_COLOUR)
    add_mesh(scene, PUSH, meshes.tube(path_m[:2], PUSH_RADIUS_M, SIDES), PUSH_COLOUR)


REGION, EDGE, PLUMB, COM = "/support/region", "/support/edge", "/support/plumb", "/support/com"
COLOUR: Colour = (0, 121, 107)
"""Colour that no foot, hand or force has."""
CORNERS = 64
"""Corners of the region; for smaller polygons the page repeats the last one."""
OPACITY = 0.3
SUPPORT_MARKS_RADIUS_M, PLUMB_RADIUS_M = 0.01, 0.004


def add_support_region(scene: viser.SceneApi) -> None:
    """Add the nodes below ``/support``: region, its edge, and the best position of the CoM."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = SUPPORT_MARKS_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    add_mesh(scene, REGION, meshes.polygon(circle), COLOUR, opacity=OPACITY)
    add_mesh(scene, EDGE, meshes.band_between(circle, 0.9 * circle), COLOUR)
    add_mesh(scene, PLUMB, meshes.cylinder(PLUMB_RADIUS_M), COM_COLOUR, side="front")
    add_com(scene, COM)
