"""Reading of each kind of document through the HTTP interface, and building of its scene."""

import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Protocol

import trimesh
import viser
from viser.infra import StateSerializer

from stridelab.client import Client, ProblemError
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.robots import Measure, RobotFacts
from stridelab.schemas.scenarios import Scenario, StoredScenario
from stridelab.translations.catalogue import in_language
from stridelab_web.api_client import FILE_GONE
from stridelab_web.config import ANONYMOUS_KEY
from stridelab_web.scene.contacts import half_sizes
from stridelab_web.scene.documents import Document, DocumentKind
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.result_files import (
    frames_of,
    needed_files,
    read_cones,
    read_plan,
    second_recording,
    shown_in_scene,
)
from stridelab_web.viewer import gait_scene, plan_scene, robot_scene, viser_recording
from stridelab_web.viewer.initial_posture import Posed
from stridelab_web.viewer.robot_links import read_links
from stridelab_web.viewer.scenario_scene import ScenarioScene

NOT_LEARNED: Final = frozenset({"reachability-not-learned", "reachability-of-another-robot"})
"""Error codes of plans without densities to show, because those that they used were replaced."""


class Live(Protocol):
    """A scene that can be updated, with the reason why the last change from within it was refused, or empty."""

    refusal: str

    def show_source(self, source: Any) -> bool:
        """Show ``source``; False if the scene must be built again."""
        ...


@dataclass(frozen=True)
class Kind:
    """``look_up`` reads what a scene depends on (compared with ==), ``build`` fills an empty server with it.

    ``record`` also records its motion for viser's own player; plans have such a recording as an artifact.
    """

    look_up: Callable[[Document], Any]
    build: Callable[[viser.ViserServer, Document, Any], Live | None]
    record: Callable[[viser.ViserServer, Document, Any], StateSerializer] | None = None


def document_kinds(client: Client, acting: Callable[[str | None], Client]) -> Mapping[DocumentKind, Kind]:
    """All kinds of documents, read through ``client``.

    Changes are stored through the client that ``acting`` creates for the key of the user, or without a key.
    """

    def store_scenario(scenario_id: str, body: Scenario, stored: StoredScenario, key: str) -> StoredScenario:
        with acting(None if key == ANONYMOUS_KEY else key) as user_client:
            return user_client.put_scenario(scenario_id, body, stored)

    def link_meshes(facts: RobotFacts) -> dict[str, trimesh.Trimesh]:
        return read_meshes(facts.name, facts.sha256)

    @lru_cache(maxsize=4)
    def read_meshes(name: str, _sha256: str) -> dict[str, trimesh.Trimesh]:
        """Meshes of one version of a robot: another one of a user's may have taken its name."""
        with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
            return read_links(client.robot_links(name, Path(folder) / "links.glb").read_bytes())

    def densities_or_none(name: str, measure: Measure | None) -> RobotReachability | None:
        try:
            return client.robot_reachability(name, measure)
        except ProblemError as refusal:
            if refusal.code in NOT_LEARNED:
                return None
            raise

    def build_recording(server: viser.ViserServer, document: Document, recording: Any) -> None:
        with in_language(document.language):
            gait_scene.build_gait_scene(server, recording, _recording_frames(client, document, recording))

    def record_recording(server: viser.ViserServer, document: Document, recording: Any) -> StateSerializer:
        frames = _recording_frames(client, document, recording)
        with in_language(document.language):
            gait_scene.build_gait_scene(server, recording, frames)
        return viser_recording.record_frames(server, frames)

    def build_plan(server: viser.ViserServer, document: Document, result: Any) -> None:
        files = {name: client.read_artifact(document.id, name) for name in needed_files(result)}
        scenario, frames = read_plan(files)
        facts = client.robot(scenario.robot)
        meshes = link_meshes(facts) if frames.bodies else {}
        seen = densities_or_none(scenario.robot, result.input.get("measure"))
        sizes = half_sizes(facts.effectors)
        plan_scene.build_plan_scene(server, scenario, sizes, frames, read_cones(files), meshes, seen)

    def build_scenario(server: viser.ViserServer, _: Document, stored: Any) -> Live:
        facts = client.robot(stored.robot)
        posed = Posed(dict(zip(facts.links, facts.link_poses, strict=True)), link_meshes(facts))
        return ScenarioScene(server, stored, half_sizes(facts.effectors), store_scenario, posed)

    def build_robot(server: viser.ViserServer, _: Document, facts: Any) -> None:
        reach = [client.robot_reachability(facts.name, measure) for measure in facts.measures]
        robot_scene.build_robot_scene(server, facts, link_meshes(facts), reach)

    return {
        "recording": Kind(lambda document: client.recording(document.id), build_recording, record_recording),
        "plan": Kind(lambda document: client.result(document.id), build_plan),
        "scenario": Kind(lambda document: client.scenario(document.id), build_scenario),
        "robot": Kind(lambda document: client.robot(document.id), build_robot),
    }


def _recording_frames(client: Client, document: Document, recording: Any) -> Frames:
    with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
        tracks = client.download_tracks(document.id, Path(folder) / "tracks.parquet").read_bytes()
    if document.job_id is None:
        return frames_of(recording, tracks, {})
    result = client.result(document.job_id)
    present = [item.name for item in result.artifacts]
    shown = _read_stored(client, document.job_id, shown_in_scene(present))
    other_id = second_recording(present, result.summary, document.id)
    return frames_of(recording, tracks, shown, None if other_id is None else _second_walk(client, other_id))


def _read_stored(client: Client, job_id: str, names: Iterable[str]) -> dict[str, bytes]:
    """Content of the artifacts ``names`` without those whose files are gone from the store."""
    contents = {}
    for name in names:
        try:
            contents[name] = client.read_artifact(job_id, name)
        except ProblemError as refusal:
            if refusal.code != FILE_GONE:
                raise
    return contents


def _second_walk(client: Client, recording_id: str) -> tuple[Any, bytes] | None:
    """A recording and its tracks; None if it has been deleted."""
    try:
        with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
            tracks = client.download_tracks(recording_id, Path(folder) / "tracks.parquet").read_bytes()
            return client.recording(recording_id), tracks
    except ProblemError:
        return None
