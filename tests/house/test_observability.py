"""What Prometheus, its alerts and the dashboard ask for is what the service tells."""

import json
import re

import yaml
from prometheus_client.parser import text_string_to_metric_families

from stridelab.service.api.app import create_app
from stridelab.service.api.metrics import CRASH_REASONS, Counts, Histogram, prometheus_text
from stridelab.service.settings import Settings
from support.docs.book import LAB, OBSERVED, ROOT, compose

ALL = compose(LAB, OBSERVED)
DEPLOY = ROOT / "deploy"
PROMETHEUS = yaml.safe_load((DEPLOY / "prometheus.yml").read_text(encoding="utf-8"))
ALERTS = yaml.safe_load((DEPLOY / "alerts.yml").read_text(encoding="utf-8"))
DASHBOARD = json.loads((DEPLOY / "grafana" / "stridelab.json").read_text(encoding="utf-8"))
ONE = Histogram(("estimate-com", "succeeded"), (1,) * 11, 1.0)
SOME = Counts(
    jobs=(("estimate-com", "running", 1),),
    durations=(ONE,),
    waiting_times=(Histogram(("estimate-com",), (1,) * 11, 1.0),),
    failures=(("estimate-com", "computation-crashed", 1),),
    lost_starts=0,
    depth={"short": 0, "long": 0},
    oldest_queued_s=0.0,
    workers_alive=1,
    workers_silent=0,
    recordings=1,
    upload_bytes=1.0,
    database_bytes=1.0,
)
SAMPLES = [
    sample for family in text_string_to_metric_families(prometheus_text(SOME).decode()) for sample in family.samples
]
LABELS = {name: {label for s in SAMPLES if s.name == name for label in s.labels} for name in {s.name for s in SAMPLES}}
STATES = {"queued", "running", "succeeded", "failed", "cancelled", "timed_out", "alive", "silent"}


def queries() -> list[str]:
    panels = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
    return panels + [rule["expr"] for group in ALERTS["groups"] for rule in group["rules"]]


def test_every_queried_metric_and_label_is_exported() -> None:
    queried = set()
    for query in queries():
        for name, selection in re.findall(r"\b(stridelab_[a-z_]+)(?:\{([^}]*)\})?", query):
            queried.add(name)
            assert name in LABELS, f"{name} is exported by no process"
            for label, value in re.findall(r'([a-z_]+)\s*=~?\s*"([^"]*)"', selection):
                assert label in LABELS[name], f"{name} has no label {label}"
                assert value in STATES | set(CRASH_REASONS.values()), f"{label}={value}"
        for grouped in re.findall(r"by \(([^)]*)\)", query):
            names = re.findall(r"\bstridelab_[a-z_]+", query)
            assert {label.strip() for label in grouped.split(",")} <= LABELS[names[0]], query
        assert query.count("(") == query.count(")")
    exported = {name.removesuffix("_bucket") for name in LABELS if not name.endswith(("_sum", "_count"))}
    assert {name.removesuffix("_bucket") for name in queried} == exported, (
        "a metric that no dashboard and no alert uses"
    )


def test_every_metric_is_explained() -> None:
    page = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8")
    families = {family.name for family in text_string_to_metric_families(prometheus_text(SOME).decode())}
    listed = page.split("## What to watch")[1].split("Worth an alert")[0]
    assert families == set(re.findall(r"`(stridelab_[a-z_]+)`", listed))


def test_prometheus_scrapes_the_address_of_the_service() -> None:
    scraped = {job["job_name"]: job for job in PROMETHEUS["scrape_configs"]}
    api = ALL["services"]["api"]
    assert scraped["stridelab"]["static_configs"][0]["targets"] == [f"api:{api['environment']['STRIDELAB_PORT']}"]
    assert "api" in api["environment"]["STRIDELAB_ALLOWED_HOSTS"].split(",")
    assert scraped["stridelab"]["metrics_path"] in create_app(Settings()).openapi()["paths"]
    token = scraped["stridelab"]["authorization"]["credentials_file"]
    assert token.removeprefix("/run/secrets/") in ALL["services"]["prometheus"]["secrets"]
    (proxy,) = scraped["proxy"]["static_configs"][0]["targets"]
    name, _, port = proxy.partition(":")
    assert name in ALL["services"]
    assert f":{port} {{" in (DEPLOY / "Caddyfile").read_text(encoding="utf-8")
    mounted = {mount.split(":")[1] for mount in ALL["services"]["prometheus"]["volumes"]}
    assert set(PROMETHEUS["rule_files"]) <= mounted


def test_grafana_finds_prometheus_and_the_dashboard() -> None:
    (source,) = yaml.safe_load((DEPLOY / "grafana" / "datasources.yml").read_text(encoding="utf-8"))["datasources"]
    assert source["url"] == "http://prometheus:9090"
    assert {panel["datasource"]["uid"] for panel in DASHBOARD["panels"]} == {source["uid"]}
    (provider,) = yaml.safe_load((DEPLOY / "grafana" / "dashboards.yml").read_text(encoding="utf-8"))["providers"]
    mounts = {m.split(":")[1] for m in ALL["services"]["grafana"]["volumes"]}
    assert any(mount.startswith(provider["options"]["path"]) for mount in mounts)
    places = [tuple(panel["gridPos"][side] for side in "xy") for panel in DASHBOARD["panels"]]
    assert len(set(places)) == len(places)


def test_every_alert_has_a_description() -> None:
    for group in ALERTS["groups"]:
        for rule in group["rules"]:
            assert rule["annotations"]["summary"].endswith(".")
