"""What is saved is read back to the last bit; damaged files are refused by name; reading imports no robot library."""

import json
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotFound, Unavailable, UnreadableFile
from stridelab.reachability import store
from stridelab.reachability.card import EffectorCard, PairReach, Reach, ReachabilityCard, SizeTrial
from stridelab.robots.robot import Robot

CARD = ReachabilityCard(
    robot="talos",
    robot_sha256="ab" * 32,
    measure="uniform",
    seed=3,
    learned_on="2026-11-21",
    samples=1000,
    fitted=800,
    tried=2700,
    rejected_share=1 - 1000 / 2700,
    versions={"numpy": "2.4"},
    effectors={
        "left_foot": EffectorCard(
            frame="contact",
            weights=(0.1 + 0.2, 0.7),
            means=((0.1, 1 / 3, 1e-17), (0.0, -0.1, 0.8)),
            covariances=(
                ((0.02, 0.001, 0.0), (0.001, 0.03, 0.0), (0.0, 0.0, 0.04)),
                ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01)),
            ),
            components=2,
            thesis_components=7,
            em_converged=True,
            bandwidth_m=0.07,
            kl_nats=0.05,
            kl_sd_nats=0.004,
            kl_draws=3000,
            held_out_log_likelihood=0.31,
            held_out_log_likelihood_sd=0.02,
            mode_m=(0.0, -0.1, 0.8),
            mode_log_density=1.7,
            reach=Reach((-0.7, -0.5, 0.0), (0.8, 0.3, 1.0), 1.1),
            sizes=(SizeTrial(1, 0.4, 0.01, 0.008, -0.2), SizeTrial(2, 0.05, 0.004, 0.0, 0.31)),
        )
    },
    pairs=(PairReach(("left_foot", "right_foot"), 1.7),),
)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "talos.json"
    store.save_card(path, CARD)
    return path


def test_it_is_read_back_to_the_last_bit(saved: Path) -> None:
    assert store.read_card(saved) == CARD
    mixture = store.read_card(saved).effectors["left_foot"].to_mixture()
    assert (mixture.means_m == np.array(CARD.effectors["left_foot"].means)).all()


def test_the_file_is_plain_json_with_the_names_of_the_contract(saved: Path) -> None:
    content = json.loads(saved.read_text(encoding="utf-8"))
    foot = content["effectors"]["left_foot"]
    assert {"weights", "means", "covariances", "reach", "kl_nats", "bandwidth_m"} <= foot.keys()
    assert foot["reach"]["com_high_m"] == [0.8, 0.3, 1.0]
    assert '"com_high_m": [0.8, 0.3, 1.0]' in saved.read_text(encoding="utf-8"), "vectors stand on one line"


def _set(*path: str | int) -> Callable[[dict[str, Any], Any], None]:
    def change(content: dict[str, Any], value: Any) -> None:
        at: Any = content
        for step in path[:-1]:
            at = at[step]
        at[path[-1]] = value

    return change


FOOT = ("effectors", "left_foot")


@pytest.mark.parametrize(
    ("path", "value", "where"),
    [
        (("samples",), "many", "samples"),
        (("measure",), "gaussian", "measure"),
        (("surprise",), 1, "surprise"),
        (("learned_on",), "yesterday", "learned_on"),
        ((*FOOT, "frame"), "world", "effectors.left_foot.frame"),
        ((*FOOT, "bandwidth_m"), 0.0, "effectors.left_foot.bandwidth_m"),
        ((*FOOT, "sizes"), [], "effectors.left_foot.sizes"),
        ((*FOOT, "weights"), [0.3, 0.8], "effectors.left_foot.weights"),
        ((*FOOT, "weights"), [1.0], "effectors.left_foot.weights"),
        ((*FOOT, "means"), [[0.0, 0.0, 0.0]], "effectors.left_foot.means"),
        ((*FOOT, "means", 1), [0.0, 0.0], "effectors.left_foot.means[1][2]"),
        ((*FOOT, "means", 1, 0), float("nan"), "effectors.left_foot.means[1][0]"),
        ((*FOOT, "covariances", 0, 0, 1), 0.5, "effectors.left_foot.covariances[0]"),
        ((*FOOT, "covariances", 1, 2, 2), -0.01, "effectors.left_foot.covariances[1]"),
        ((*FOOT, "components"), 7, "effectors.left_foot.weights"),
        ((*FOOT, "reach", "com_distance_max_m"), None, "effectors.left_foot.reach.com_distance_max_m"),
    ],
)
def test_damage_is_named_by_file_and_place(saved: Path, path: tuple[str | int, ...], value: Any, where: str) -> None:
    content = json.loads(saved.read_text(encoding="utf-8"))
    _set(*path)(content, value)
    saved.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(UnreadableFile) as refusal:
        store.read_card(saved)
    assert refusal.value.code == "reachability-damaged"
    assert "talos.json" in refusal.value.message
    assert where in {fault.where for fault in refusal.value.faults}


def test_an_effector_without_components_is_refused(saved: Path) -> None:
    content = json.loads(saved.read_text(encoding="utf-8"))
    content["effectors"]["left_foot"] |= {"weights": [], "means": [], "covariances": [], "components": 0}
    saved.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(UnreadableFile):
        store.read_card(saved)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b"\x93NUMPY\x01\x00", b"\xff\xfe{}"])
def test_what_is_no_card_at_all_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.json"
    path.write_bytes(content)
    with pytest.raises(UnreadableFile) as refusal:
        store.read_card(path)
    assert "broken.json" in refusal.value.message


def test_a_truncated_file_is_refused(saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[:-40])
    with pytest.raises(UnreadableFile):
        store.read_card(saved)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile) as refusal:
        store.read_card(tmp_path / "nothing.json")
    assert "nothing.json" in refusal.value.message


def test_an_unknown_measure_is_refused_before_any_file_is_read() -> None:
    with pytest.raises(InvalidInput) as refusal:
        store._bundled_path("talos", "../talos/uniform", ".json")
    assert refusal.value.code == "measure-unknown"
    assert "conditioned" in refusal.value.message


@pytest.mark.parametrize("name", ["nao", "", "../robots/talos", "talos.json"])
def test_an_unknown_robot_is_refused_before_any_file_is_read(name: str) -> None:
    with pytest.raises(NotFound) as refusal:
        store.load_card(name)
    assert refusal.value.code == "robot-not-found"
    assert "talos" in refusal.value.message


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A models folder of this test's own, looked at without the cache."""
    monkeypatch.setattr(store, "models_dir", lambda: tmp_path)
    monkeypatch.setattr(store, "load_card", store.load_card.__wrapped__)
    folder = tmp_path / "reachability" / "talos"
    folder.mkdir(parents=True)
    return folder / "uniform.json"


def test_a_robot_without_learned_densities_is_refused(elsewhere: Path) -> None:
    with pytest.raises(NotFound) as refusal:
        store.load_proxies("talos", "uniform")
    assert refusal.value.code == "reachability-not-learned"


@pytest.mark.parametrize(
    ("field", "before", "after"), [("robot", "talos", "nao"), ("measure", "uniform", "conditioned")]
)
def test_a_file_with_other_contents_is_refused(
    elsewhere: Path, saved: Path, field: str, before: str, after: str
) -> None:
    content = saved.read_text(encoding="utf-8")
    elsewhere.write_text(content.replace(f'"{field}": "{before}"', f'"{field}": "{after}"'), encoding="utf-8")
    with pytest.raises(UnreadableFile) as refusal:
        store.load_proxies("talos", "uniform")
    assert refusal.value.faults[0].where == field


COM_M = {"left_foot": np.random.default_rng(0).normal(0.0, 0.4, (store.CLOUD_SAMPLES + 7, 3))}


@pytest.fixture
def cloud(tmp_path: Path) -> Path:
    path = tmp_path / "uniform.npz"
    store.save_cloud(path, COM_M)
    return path


def test_a_cloud_is_read_back_to_half_a_millimetre(cloud: Path, tmp_path: Path) -> None:
    read = store.read_cloud(cloud)
    assert list(read) == ["left_foot"]
    assert read["left_foot"].shape == (store.CLOUD_SAMPLES, 3)
    np.testing.assert_allclose(read["left_foot"], COM_M["left_foot"][: store.CLOUD_SAMPLES], atol=0.5e-3 + 1e-12)
    with np.load(cloud, allow_pickle=False) as arrays:
        assert arrays["left_foot"].dtype == np.int16
    store.save_cloud(tmp_path / "again.npz", COM_M)
    assert (tmp_path / "again.npz").read_bytes() == cloud.read_bytes()


@pytest.mark.parametrize("content", [b"", b"PK", b"[]", b"\x93NUMPY\x01\x00"])
def test_a_cloud_that_is_no_archive_is_refused(cloud: Path, content: bytes) -> None:
    cloud.write_bytes(content)
    with pytest.raises(UnreadableFile) as refusal:
        store.read_cloud(cloud)
    assert (refusal.value.code, "uniform.npz" in refusal.value.message) == ("reachability-damaged", True)


def test_a_truncated_or_flipped_cloud_is_refused(cloud: Path) -> None:
    whole = cloud.read_bytes()
    for at in range(0, len(whole), max(1, len(whole) // 60)):
        cloud.write_bytes(whole[:at])
        with pytest.raises(UnreadableFile):
            store.read_cloud(cloud)
    for at in range(100, min(1000, len(whole) // 2), 7):  # in the data of the first array
        cloud.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        with pytest.raises(UnreadableFile):
            store.read_cloud(cloud)


def test_a_cloud_with_an_invalid_header_is_refused(cloud: Path) -> None:
    with zipfile.ZipFile(cloud, "w") as packed:
        packed.writestr("left_foot.npy", b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + b"(" * 117 + b"\n")
    with pytest.raises(UnreadableFile):
        store.read_cloud(cloud)


class Payload:
    """What a pickle could smuggle in."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, ("raise SystemExit('it ran')",)


@pytest.mark.parametrize(
    "values",
    [
        np.array([[0.1, 0.2, np.nan]]),
        np.zeros((4, 2), dtype=np.int16),
        np.zeros((0, 3), dtype=np.int16),
        np.zeros(3, dtype=np.int16),
        np.array([[Payload()] * 3], dtype=object),
        np.zeros((1_000_000, 3), dtype=np.int16),
    ],
    ids=["float with NaN", "two columns", "nothing", "one point", "pickle", "too large"],
)
def test_a_hostile_cloud_is_refused_and_not_run(cloud: Path, values: np.ndarray) -> None:
    np.savez_compressed(cloud, left_foot=values)
    with pytest.raises(UnreadableFile) as refusal:
        store.read_cloud(cloud)
    assert refusal.value.code == "reachability-damaged"


def test_a_cloud_of_other_effectors_than_the_card_is_refused(elsewhere: Path, saved: Path) -> None:
    elsewhere.write_bytes(saved.read_bytes())
    store.save_cloud(elsewhere.with_suffix(".npz"), {"right_foot": COM_M["left_foot"]})
    with pytest.raises(UnreadableFile) as refusal:
        store.load_cloud("talos", "uniform")
    assert refusal.value.faults[0].where == "effectors"


def test_densities_of_another_description_are_refused(talos: Robot) -> None:
    store.require_same_robot(replace(CARD, robot_sha256=talos.sha256), talos)
    with pytest.raises(Unavailable) as refusal:
        store.require_same_robot(CARD, talos)
    assert refusal.value.code == "reachability-of-another-robot"
    assert "TALOS" in refusal.value.message
    assert refusal.value.faults[0].where == "robot_sha256"


def test_proxies_are_read_only() -> None:
    proxies = store.load_proxies("talos")
    with pytest.raises(TypeError):
        proxies["left_foot"] = proxies["right_foot"]  # type: ignore[index]


def test_reading_imports_no_robot_library() -> None:
    code = (
        "import sys; from stridelab.reachability.store import load_proxies; load_proxies('talos'); "
        "sys.exit(', '.join({'pinocchio', 'sklearn', 'coal'} & set(sys.modules)) or 0)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
