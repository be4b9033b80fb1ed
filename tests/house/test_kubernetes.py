"""The folder for Kubernetes is consistent with itself, with the compose file, the image and the program.

``kubectl kustomize deploy/kubernetes/lab`` renders it without a cluster; here its files are read as they are.
"""

import re
from typing import Any

import pytest
import yaml
from typer.main import get_command

from stridelab.cli.app import app
from stridelab.machine.cluster import scheduler_address
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.postgres.paths import MAJOR_VERSION
from stridelab.service.settings import Settings
from stridelab.service.storage import tables
from support.docs.book import LAB, ROOT, compose

FOLDER = ROOT / "deploy" / "kubernetes"
PARTS = ("base", "postgres", "keda", "dask", "lab")
OURS = ("api", "worker", "migrate")


def objects(part: str) -> list[dict[str, Any]]:
    """The resources that the kustomization of a part lists, which are all its files."""
    names = [name for name in kustomization(part).get("resources", []) if not name.startswith("..")]
    files = {path.name for path in (FOLDER / part).glob("*.yaml")} - {"kustomization.yaml"}
    assert set(names) == files, part
    return [one for name in names for one in yaml.safe_load_all((FOLDER / part / name).read_text(encoding="utf-8"))]


def kustomization(part: str) -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((FOLDER / part / "kustomization.yaml").read_text(encoding="utf-8"))
    return read


ALL = {(one["kind"], one["metadata"]["name"]): one for part in PARTS for one in objects(part)}


def pod(component: str) -> dict[str, Any]:
    (workload,) = (
        one["spec"]["template"]["spec"]
        for one in ALL.values()
        if one["kind"] in {"Deployment", "Job"} and one["metadata"]["name"] == f"stridelab-{component}"
    )
    assert isinstance(workload, dict)
    return workload


def shared_settings() -> dict[str, str]:
    lines = (FOLDER / "base" / "settings.env").read_text(encoding="utf-8").split()
    return dict(line.split("=", 1) for line in lines)


def environment(component: str) -> dict[str, str]:
    (container,) = pod(component)["containers"]
    return shared_settings() | {one["name"]: one["value"] for one in container.get("env", [])}


def test_the_kubernetes_example_uses_every_part() -> None:
    lab = kustomization("lab")
    used = {name.removeprefix("../") for name in (*lab["resources"], *lab["components"]) if name.startswith("../")}
    assert used == set(PARTS) - {"lab"} == {path.name for path in FOLDER.iterdir()} - {"lab"}
    images = {container["image"] for component in OURS for container in pod(component)["containers"]}
    images |= set(re.findall(r"image: (\S+)", (FOLDER / "dask" / "cluster.yaml").read_text(encoding="utf-8")))
    assert images == {image["name"] for image in lab["images"]} == {"stridelab"}


@pytest.mark.parametrize("component", OURS)
def test_every_variable_is_a_setting_with_a_valid_value(component: str) -> None:
    known = {f"STRIDELAB_{name.upper()}" for name in Settings.model_fields}
    values = environment(component)
    assert set(values) <= known
    settings = Settings(**{name.removeprefix("STRIDELAB_").lower(): value for name, value in values.items()})  # type: ignore[arg-type]
    assert settings.database_url
    for name, value in values.items():
        if any(word in name for word in ("PASSWORD", "TOKEN", "CREDENTIALS", "SECRET")):
            assert name.endswith("_FILE"), name
            generated = {file.removeprefix("secrets/") for file in kustomization("lab")["secretGenerator"][0]["files"]}
            assert value.removeprefix("/run/secrets/stridelab/") in generated


@pytest.mark.parametrize("component", OURS)
def test_pods_are_confined_as_the_containers_of_the_compose_file_are(component: str) -> None:
    spec, service = pod(component), compose(LAB)["services"][component]
    (container,) = spec["containers"]
    assert container["args"] == service["command"]
    assert spec["securityContext"]["runAsUser"] == int(service["user"])
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["automountServiceAccountToken"] is False
    confined = container["securityContext"]
    assert confined["readOnlyRootFilesystem"] is True
    assert confined["allowPrivilegeEscalation"] is False
    assert confined["capabilities"]["drop"] == ["ALL"]
    assert container["resources"]["limits"]["memory"].removesuffix("i").lower() == service["mem_limit"]
    writable = {mount["mountPath"] for mount in container["volumeMounts"] if not mount.get("readOnly")}
    assert writable == {"/tmp", shared_settings()["STRIDELAB_DATA_DIR"]}
    assert {mount["name"] for mount in container["volumeMounts"]} == {volume["name"] for volume in spec["volumes"]}


def test_commands_exist() -> None:
    commands = get_command(app).commands  # type: ignore[attr-defined]
    for component in OURS:
        (container,) = pod(component)["containers"]
        probe = container.get("livenessProbe", {}).get("exec", {}).get("command", [])
        assert probe[:3] == (["python", "-m", "stridelab.cli"] if probe else [])
        for called in (container["args"], probe[3:]):
            if called:
                known = {flag for parameter in commands[called[0]].params for flag in parameter.opts}
                assert {word for word in called if word.startswith("--")} <= known


def test_a_request_is_routed_to_the_web_server() -> None:
    ingress, service = ALL["Ingress", "stridelab"], ALL["Service", "stridelab-api"]
    (path,) = ingress["spec"]["rules"][0]["http"]["paths"]
    assert path["backend"]["service"]["name"] == "stridelab-api"
    (container,) = pod("api")["containers"]
    assert [port["containerPort"] for port in container["ports"]] == [int(environment("api")["STRIDELAB_PORT"])]
    assert service["spec"]["ports"][0]["port"] == container["ports"][0]["containerPort"]
    assert {port["targetPort"] for port in service["spec"]["ports"]} == {port["name"] for port in container["ports"]}
    labels = ALL["Deployment", "stridelab-api"]["spec"]["template"]["metadata"]["labels"]
    assert service["spec"]["selector"].items() <= labels.items()
    # Scenes and live robots are in the memory of one web server: a browser stays with it.
    assert service["spec"]["sessionAffinity"] == "ClientIP"
    assert ingress["metadata"]["annotations"]["nginx.ingress.kubernetes.io/affinity"] == "cookie"
    (patch,) = kustomization("lab")["patches"]
    (change,) = yaml.safe_load(patch["patch"])
    place = [one["name"] for one in container["env"]].index("STRIDELAB_ALLOWED_HOSTS")
    assert change["path"] == f"/spec/template/spec/containers/0/env/{place}/value"
    hosts = change["value"].split(",")
    assert ingress["spec"]["rules"][0]["host"] in hosts
    probe = container["readinessProbe"]["httpGet"]
    assert probe["httpHeaders"][0]["value"] in hosts
    assert probe["path"] == "/api/v1/health"


def test_the_queue_is_counted_in_the_tables_that_there_are() -> None:
    scaled = ALL["ScaledObject", "stridelab-worker"]["spec"]
    assert ("Deployment", scaled["scaleTargetRef"]["name"]) in ALL
    (trigger,) = scaled["triggers"]
    counted = re.fullmatch(r"SELECT count\(\*\) FROM (\w+) WHERE (\w+) IN \((.*)\)", trigger["metadata"]["query"])
    assert counted
    assert counted[1] == tables.job.name
    assert counted[2] in tables.job.c
    states = set(re.findall(r"'(\w+)'", counted[3]))
    assert states == {"queued", "running"}
    assert not states & set(FINAL_STATES)
    authentication = ALL["TriggerAuthentication", trigger["authenticationRef"]["name"]]["spec"]["secretTargetRef"][0]
    secrets = {secret["name"]: secret for secret in kustomization("lab")["secretGenerator"]}
    assert f"secrets/{authentication['key']}" in secrets[authentication["name"]]["files"]


def test_the_database_is_where_the_settings_look() -> None:
    database = ALL["Cluster", "stridelab-postgres"]
    url = shared_settings()["STRIDELAB_DATABASE_URL"]
    owner, name = (database["spec"]["bootstrap"]["initdb"][key] for key in ("owner", "database"))
    assert url == f"postgresql://{owner}@{database['metadata']['name']}-rw:5432/{name}"
    assert database["spec"]["imageName"].endswith(f":{MAJOR_VERSION}")
    secrets = {secret["name"] for secret in kustomization("lab")["secretGenerator"]}
    assert database["spec"]["bootstrap"]["initdb"]["secret"]["name"] in secrets


def test_the_dask_scheduler_is_where_the_settings_look_and_only_workers_reach_it() -> None:
    cluster = ALL["DaskCluster", "stridelab-dask"]
    ((setting,),) = (one["literals"] for one in kustomization("dask")["configMapGenerator"])
    variable, url = setting.split("=")
    assert variable == "STRIDELAB_DASK_URL"
    scheduler = cluster["spec"]["scheduler"]
    (port,) = scheduler["spec"]["containers"][0]["ports"]
    assert scheduler_address(url) == (f"{cluster['metadata']['name']}-scheduler", port["containerPort"])
    assert ALL["DaskAutoscaler", "stridelab-dask"]["spec"]["cluster"] == cluster["metadata"]["name"]
    sources = ALL["NetworkPolicy", "stridelab-dask"]["spec"]["ingress"][0]["from"]
    labels = ALL["Deployment", "stridelab-worker"]["spec"]["template"]["metadata"]["labels"]
    assert labels in [source["podSelector"]["matchLabels"] for source in sources]
    assert len(sources) == 2
