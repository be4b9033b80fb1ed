"""The compose files are consistent with each other, with the images and with the program."""

import shlex
from ipaddress import ip_address, ip_network
from typing import Any

import pytest
import yaml

from stridelab.service.api.app import create_app
from stridelab.service.postgres.paths import MAJOR_VERSION
from stridelab.service.settings import Settings
from support.docs.book import LAB, OBSERVED, OURS, ROOT, compose, megabytes

FILES = {"lab": (LAB,), "observed": (LAB, OBSERVED)}
ALL = compose(LAB, OBSERVED)
NAMES = sorted(ALL["services"])
DOCKERFILE = (ROOT / "backend" / "Dockerfile").read_text(encoding="utf-8")
CADDY = (ROOT / "deploy" / "Caddyfile").read_text(encoding="utf-8")


def own() -> list[tuple[str, dict[str, Any]]]:
    return [(name, service) for name, service in ALL["services"].items() if service["image"] == OURS]


@pytest.mark.parametrize("files", FILES.values(), ids=FILES)
def test_names_in_the_compose_file_are_declared_and_declarations_used(files: tuple[Any, ...]) -> None:
    whole = compose(*files)
    used: dict[str, set[str]] = {"secrets": set(), "volumes": set(), "networks": set()}
    for service in whole["services"].values():
        for name, how in service.get("depends_on", {}).items():
            waited_for = whole["services"][name]
            assert how["condition"] != "service_healthy" or "healthcheck" in waited_for
            assert how["condition"] != "service_completed_successfully" or waited_for["restart"] == "no"
        used["secrets"] |= set(service.get("secrets", []))
        used["networks"] |= set(service["networks"])
        mounts = [mount.split(":")[0] for mount in service.get("volumes", [])]
        used["volumes"] |= {mount for mount in mounts if not mount.startswith((".", "/"))}
        assert all((ROOT / mount).is_file() for mount in mounts if mount.startswith("."))
    for part, names in used.items():
        assert names == set(whole[part]), part


@pytest.mark.parametrize("name", NAMES)
def test_every_container_is_confined(name: str) -> None:
    service = ALL["services"][name]
    assert service["init"] is True
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["pids_limit"] == 512
    assert "privileged" not in service
    assert "cap_add" not in service
    assert int(service["user"].split(":")[0]) > 0
    assert megabytes(service["mem_limit"]) >= 256
    assert service["restart"] == ("no" if name == "migrate" else "unless-stopped")
    assert ("healthcheck" in service) is (name != "migrate")


def test_only_the_proxy_can_be_reached_from_elsewhere() -> None:
    published = {name: service["ports"] for name, service in ALL["services"].items() if "ports" in service}
    assert published == {"caddy": ["80:8080", "443:8443"], "grafana": ["127.0.0.1:3000:3000"]}
    assert ALL["networks"]["inside"]["internal"] is True
    assert {name for name, service in ALL["services"].items() if "outside" in service["networks"]} == set(published)
    for line in ("http_port 8080", "https_port 8443", "dynamic a api 8000", ":8081 {", "respond /healthy 200"):
        assert line in CADDY


def test_addresses_of_clients_are_taken_from_the_proxy_alone() -> None:
    proxy = ALL["services"]["caddy"]["networks"]["inside"]["ipv4_address"]
    assert ALL["services"]["api"]["environment"]["FORWARDED_ALLOW_IPS"] == proxy
    (pool,) = ALL["networks"]["inside"]["ipam"]["config"]
    assert ip_address(proxy) in ip_network(pool["subnet"])
    assert ip_address(proxy) not in ip_network(pool["ip_range"]), "no other container gets it"


def test_every_variable_is_a_setting_and_no_secret_is_a_variable() -> None:
    known = {f"STRIDELAB_{name.upper()}" for name in Settings.model_fields}
    for name, service in ALL["services"].items():
        variables = service.get("environment", {})
        assert {variable for variable in variables if variable.startswith("STRIDELAB_")} <= known
        for variable, value in variables.items():
            if any(word in variable for word in ("PASSWORD", "TOKEN", "CREDENTIALS", "SECRET")):
                assert variable.endswith("_FILE"), f"{name} {variable}"
                assert value.removeprefix("/run/secrets/") in service["secrets"], f"{name} {value}"
    for name, service in own():
        values = {name.removeprefix("STRIDELAB_").lower(): value for name, value in service["environment"].items()}
        assert Settings(**values).database_url, name  # and takes the values


def test_folders_that_are_written_are_volumes_that_the_image_prepares() -> None:
    prepared = next(line for line in DOCKERFILE.splitlines() if "install -d -o stridelab" in line).split()
    for name, service in own():
        mounts = {mount.split(":")[-1] for mount in service["volumes"]}
        environment = service["environment"]
        assert mounts == {environment["STRIDELAB_BLOB_URL"].removeprefix("file://"), environment["STRIDELAB_DATA_DIR"]}
        assert mounts <= set(prepared), name
        assert f"--uid {service['user']}" in DOCKERFILE
    assert f"-u {ALL['services']['caddy']['user']}" in DOCKERFILE


def test_one_shot_migration_comes_before_everything_that_needs_tables() -> None:
    for name, service in own():
        if name != "migrate":
            assert service["depends_on"]["migrate"]["condition"] == "service_completed_successfully"


def test_commands_and_health_checks_exist() -> None:
    from typer.main import get_command

    from stridelab.cli.app import app

    commands = get_command(app).commands  # type: ignore[attr-defined]
    for name, service in own():
        check = service.get("healthcheck", {}).get("test", [])
        assert not check or check[:4] == ["CMD", "python", "-m", "stridelab.cli"]
        for called in (service["command"], check[4:]):
            if called:
                command, *rest = called
                known = {flag for parameter in commands[command].params for flag in parameter.opts}
                assert {word for word in rest if word.startswith("--")} <= known, f"{name}: {called}"
    api = ALL["services"]["api"]
    assert api["healthcheck"]["test"][-1].endswith(f":{api['environment']['STRIDELAB_PORT']}")


def test_jobs_fit_into_their_container() -> None:
    worker = ALL["services"]["worker"]
    slots = int(worker["environment"]["STRIDELAB_WORKER_SLOTS"]) + 1  # and the one for short jobs
    needed_mb = slots * int(worker["environment"]["STRIDELAB_JOB_MEMORY_MB"]) * 1e6 / 2**20
    assert needed_mb < megabytes(worker["mem_limit"]) - 512


def test_the_proxy_lets_the_largest_upload_through_and_leaves_event_streams_alone() -> None:
    limit_mb = int(next(line for line in CADDY.splitlines() if "max_size" in line).split()[1].removesuffix("MB"))
    assert Settings().max_batch_mb < limit_mb < 1.2 * Settings().max_batch_mb
    assert "encode @still" in CADDY
    spared = next(line for line in CADDY.splitlines() if "@still not path" in line).split()[3:]
    streams = {
        path.replace("{job_id}", "*")
        for path, calls in create_app(Settings()).openapi()["paths"].items()
        for call in calls.values()
        if any("text/event-stream" in answer.get("content", {}) for answer in call["responses"].values())
    }
    assert set(spared) == streams != set()


def test_the_database_is_of_the_version_that_the_embedded_one_has() -> None:
    assert ALL["services"]["postgres"]["image"] == f"postgres:{MAJOR_VERSION}"


def test_images_copy_existing_files_and_run_without_root() -> None:
    stages = DOCKERFILE.split("\nFROM ")[1:]
    names = [stage.splitlines()[0].split(" AS ")[1] for stage in stages]
    targets = {service["build"]["target"] for service in ALL["services"].values() if "build" in service}
    assert targets == {"service", "proxy"} <= set(names)
    for name, stage in zip(names, stages, strict=True):
        if name in targets:
            assert int(stage.rsplit("\nUSER ", 1)[1].split()[0]) > 0
    copied = {
        word
        for line in DOCKERFILE.splitlines()
        if line.startswith("COPY") and "--from" not in line
        for word in shlex.split(line)[1:-1]
    }
    assert {"backend", "frontend", "models", "pyproject.toml", "requirements.lock", "deploy/Caddyfile"} <= copied
    assert all((ROOT / name).exists() for name in copied)
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert "secrets" in ignored
    assert not copied & set(ignored)


def test_secrets_are_files_that_git_does_not_take() -> None:
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    assert any(line.strip("/") == "secrets" for line in ignored)
    for secret in ALL["secrets"].values():
        file = ROOT / secret["file"]
        assert file.parent.name == "secrets" or file.read_text() == ""


def test_the_files_are_valid_yaml_of_one_document_each() -> None:
    for file in (LAB, OBSERVED, *(ROOT / "deploy").rglob("*.yml")):
        assert yaml.safe_load(file.read_text(encoding="utf-8"))
