"""What is deployed is of the right form, starts programs with flags that they have, and gives nobody root."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import jsonschema
import kubernetes_validate
import pytest
import yaml

from robot_farm.policy.jailed_policy import NEEDS
from robot_farm.settings import ALIVE_VARIABLE, TOKEN_VARIABLE, parse
from services.__main__ import parsed
from services.settings import Settings
from services.verification.confined import MEMORY_LIMIT_BYTES
from sim_backend.tasks import TASKS

ROOT = Path(__file__).parents[2]
KUBERNETES, SCALED = ROOT / "deploy/kubernetes", ROOT / "deploy/kubernetes-scaled"
KEDA = "github.com/kedacore/keda/v2@v2.21.0"
VERSION = "1.30"
OF_FLAGS = {"data", "host", "port", "bus", "bus_connect", "dispatches"}
"""Settings that the commands of the compose file give."""
OF_A_PROXY = {"tls_certificate", "tls_key"}
"""Robots and the health check of the compose file speak http with the API; before it stands a proxy, which does the rest."""
OF_ROUTERS = {"bus_key", "bus_routers"}
OF_ROBOTS = {"TRIFARM_ROBOT_TOKEN", "TRIFARM_FARM_SEED", ALIVE_VARIABLE}
WITHOUT_HTTP = {"dispatcher", "robot"}


def resources():
    """Everything that the kustomization names."""
    named = yaml.safe_load((KUBERNETES / "kustomization.yaml").read_text())["resources"]
    return [each for name in named for each in yaml.safe_load_all((KUBERNETES / name).read_text())]


def rendered():
    """The same as it goes to a cluster."""
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl, which renders the kustomization, is not installed")
    done = subprocess.run(["kubectl", "kustomize", str(KUBERNETES)], capture_output=True, text=True, check=True)
    return list(yaml.safe_load_all(done.stdout))


@pytest.mark.parametrize("made", [resources, rendered])
def test_all_of_it_is_of_the_form_that_kubernetes_has(made):
    found = made()
    kinds = {"Namespace", "Deployment", "StatefulSet", "Service", "NetworkPolicy", "PodDisruptionBudget"}
    assert kinds == {each["kind"] for each in found}
    for each in found:
        kubernetes_validate.validate(each, VERSION, strict=True)


def test_what_is_not_of_that_form_is_found():
    broken = next(each for each in resources() if each["kind"] == "Deployment")
    broken["spec"]["replica"] = broken["spec"].pop("replicas")
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, VERSION, strict=True)


def scaled_object():
    return yaml.safe_load((SCALED / "scaledobject.yaml").read_text())


def test_what_scales_robots_is_of_the_form_that_keda_publishes():
    """Its schema comes with its source, where Go's cache has that: go mod download github.com/kedacore/keda/v2@v2.21.0."""
    found = sorted(Path.home().glob(f"go/pkg/mod/{KEDA}/config/crd/bases/keda.sh_scaledobjects.yaml"))
    if not found:
        pytest.skip(f"{KEDA}, which has the schema, is not in the cache of Go's modules")
    schema = closed(yaml.safe_load(found[0].read_text())["spec"]["versions"][0]["schema"]["openAPIV3Schema"])
    schema["properties"]["metadata"] = {"type": "object"}
    jsonschema.validate(scaled_object(), schema)
    wrong = scaled_object()
    wrong["spec"]["maxReplicas"] = wrong["spec"].pop("maxReplicaCount")
    with pytest.raises(jsonschema.ValidationError, match="maxReplicas"):
        jsonschema.validate(wrong, schema)


def closed(schema):
    """The schema, which as a cluster takes it lets no unknown field pass."""
    if isinstance(schema, dict):
        if "properties" in schema:
            schema.setdefault("additionalProperties", False)
        for each in schema.values():
            closed(each)
    return schema


def test_robots_are_scaled_by_what_the_services_say_and_finish_their_trials():
    spec = scaled_object()["spec"]
    (robot,) = (each for each in resources() if (each["kind"], each["metadata"]["name"]) == ("StatefulSet", "robot"))
    assert (spec["scaleTargetRef"]["kind"], spec["scaleTargetRef"]["name"]) == (robot["kind"], robot["metadata"]["name"])
    (trigger,) = spec["triggers"]
    (metric,) = re.findall(r"trifarm_\w+", trigger["metadata"]["query"])
    assert f'"{metric}"' in (ROOT / "services/api/metrics.py").read_text()
    pod = robot["spec"]["template"]["spec"]
    arguments = pod["containers"][0]["args"]
    drain_s = float(arguments[arguments.index("--drain-s") + 1])
    assert max(task.duration_s for task in TASKS.values()) < drain_s < pod["terminationGracePeriodSeconds"]


def test_the_number_of_scaled_robots_is_nobodys_but_the_autoscalers():
    if shutil.which("kubectl") is None:
        pytest.skip("kubectl, which renders the kustomization, is not installed")
    done = subprocess.run(["kubectl", "kustomize", str(SCALED)], capture_output=True, text=True, check=True)
    found = list(yaml.safe_load_all(done.stdout))
    (robot,) = (each for each in found if (each["kind"], each["metadata"]["name"]) == ("StatefulSet", "robot"))
    assert "replicas" not in robot["spec"] and "ScaledObject" in {each["kind"] for each in found}


def test_what_users_send_meets_its_own_limit_of_memory_before_that_of_the_pod():
    limits = {app: container["resources"]["limits"]["memory"] for app, container, _ in pods()}
    assert int(limits["robot"].removesuffix("Gi")) << 30 > NEEDS.memory_bytes
    assert int(limits["api"].removesuffix("Gi")) << 30 > MEMORY_LIMIT_BYTES


def test_no_pod_takes_the_whole_node_or_speaks_to_the_cluster():
    for each in resources():
        if each["kind"] in {"Deployment", "StatefulSet"}:
            pod = each["spec"]["template"]["spec"]
            assert pod["automountServiceAccountToken"] is False, each["metadata"]["name"]
            for container in pod["containers"]:
                assert {"cpu", "memory"} <= set(container["resources"]["requests"]) and container["resources"]["limits"]["memory"]


def composed():
    """The containers of the compose file."""
    return yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]


def containers():
    """Image, arguments and variables of every container of ours: (where, image, arguments, names of variables)."""
    for each in resources():
        if each["kind"] in {"Deployment", "StatefulSet"}:
            pod = each["spec"]["template"]["spec"]
            assert pod["securityContext"]["runAsNonRoot"]
            for inside in pod["containers"]:
                assert not inside["securityContext"]["allowPrivilegeEscalation"]
                yield each["metadata"]["name"], inside["image"], inside["args"], {row["name"] for row in inside.get("env", ())}
    for name, inside in composed().items():
        assert inside["cap_drop"] == ["ALL"], name
        if inside["image"] in {"trifarm-api", "trifarm-robot"}:
            yield f"compose {name}", inside["image"], inside["command"], set(inside["environment"])


@pytest.mark.parametrize(("image", "arguments", "variables"), [pytest.param(*row, id=where) for where, *row in containers()])
def test_programs_are_started_with_what_they_take(image, arguments, variables, monkeypatch):
    arguments = [each.replace("$(NUMBER)", "3").replace("${PHYSICS:-real}", "real") for each in arguments]
    if image == "trifarm-robot":
        monkeypatch.setenv(TOKEN_VARIABLE, "token")
        assert parse(arguments).first in {3, None}
    else:
        assert parsed(arguments)[1].bus_endpoints[0].startswith("tls/")
    known = OF_ROBOTS | {f"TRIFARM_{field.upper()}" for field in Settings.model_fields}
    assert {name for name in variables if name.startswith("TRIFARM_")} <= known


def test_robots_reach_only_the_api_and_the_bus():
    farm = composed()
    of_robots = set(farm["robot"]["networks"])
    assert {name for name, inside in farm.items() if of_robots & set(inside["networks"])} == {"robot", "api", "router"}
    assert set(yaml.safe_load((ROOT / "docker-compose.yml").read_text())["networks"]) == {"inside", "robots"}


def test_no_container_takes_the_whole_machine():
    for name, inside in composed().items():
        assert inside["pids_limit"] > 0, name
        assert int(inside["mem_limit"].removesuffix("g")) << 30 > (NEEDS.memory_bytes if name == "robot" else 0), name


def test_containers_write_only_where_they_must():
    for name, inside in composed().items():
        if inside["image"] == "trifarm-api":
            assert inside["volumes"] == ["/tmp"], name
        assert inside["read_only"] and "/tmp" in [*inside["volumes"], *inside.get("tmpfs", ())], name
    api = re.search(r"^FROM python AS api$(.*?)^FROM ", (ROOT / "Dockerfile").read_text(), re.MULTILINE | re.DOTALL)
    assert api is not None
    assert "VOLUME /data" in api[1]


def pods():
    """The containers of the pods on Kubernetes, with what these can write: (app, container, volumes by name)."""
    for each in resources():
        if each["kind"] in {"Deployment", "StatefulSet"}:
            inside = each["spec"]["template"]
            (container,) = inside["spec"]["containers"]
            yield inside["metadata"]["labels"]["app"], container, {row["name"]: row for row in inside["spec"]["volumes"]}


def test_pods_write_only_where_they_must():
    for app, container, volumes in pods():
        assert container["securityContext"]["readOnlyRootFilesystem"], app
        mounted = {row["mountPath"]: volumes[row["name"]] for row in container["volumeMounts"]}
        assert set(mounted) == {"/data", "/tmp"} and all("emptyDir" in row for row in mounted.values()), app


def test_every_container_is_asked_whether_it_lives():
    for name, inside in composed().items():
        assert inside["healthcheck"]["test"], name
    for app, container, _ in pods():
        assert container["livenessProbe"], app
        if app in WITHOUT_HTTP:
            assert container["startupProbe"]["exec"] == container["livenessProbe"]["exec"], app
            assert {"name": ALIVE_VARIABLE, "value": "/tmp/alive"} in container["env"], app
            assert container["livenessProbe"]["exec"]["command"][1:] == composed()[app]["healthcheck"]["test"][2:]
            assert composed()[app]["environment"][ALIVE_VARIABLE] == "/tmp/alive", app


def test_on_kubernetes_robots_speak_to_the_api_and_the_bus_alone():
    found = {each["metadata"]["name"]: each["spec"] for each in resources() if each["kind"] == "NetworkPolicy"}
    assert found["nobody"] == {"podSelector": {}, "policyTypes": ["Ingress"]}
    assert {name: spec["podSelector"]["matchLabels"]["app"] for name, spec in found.items() if name != "nobody"} == {
        app: app for app in ("api", "router", "robot", "dispatcher")
    }
    assert {app for app, _, _ in pods()} == {"api", "router", "robot", "dispatcher"}
    ports = {app: container["ports"][0]["containerPort"] for app, container, _ in pods() if "ports" in container}
    reached = {}
    for rule in found["robot"]["egress"]:
        (to,) = rule["to"]
        reached[to.get("podSelector", {}).get("matchLabels", {}).get("app")] = [port["port"] for port in rule["ports"]]
    assert found["robot"]["policyTypes"] == ["Egress"]
    assert reached == {"api": [ports["api"]], "router": [ports["router"]], None: [53, 53]}
    for app in ("api", "router", "dispatcher"):
        assert [port["port"] for rule in found[app]["ingress"] for port in rule["ports"]] == [ports[app]]


def test_on_kubernetes_the_metrics_of_dispatchers_are_for_prometheus_alone():
    (template,) = (
        each["spec"]["template"]
        for each in resources()
        if each["metadata"]["name"] == "dispatcher" and "replicas" in each["spec"]
    )
    (container,) = template["spec"]["containers"]
    told = parsed(container["args"])[1]
    asked = int(template["metadata"]["annotations"]["prometheus.io/port"])
    assert told.host == "0.0.0.0" and container["ports"][0]["containerPort"] == told.metrics_port == asked
    (policy,) = (each for each in resources() if each["kind"] == "NetworkPolicy" and each["metadata"]["name"] == "dispatcher")
    (rule,) = policy["spec"]["ingress"]
    assert rule["from"] == [{"namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": "monitoring"}}}]


def test_the_services_are_told_the_physics_of_the_robots():
    robot = composed()["robot"]["command"]
    told = robot[robot.index("--physics") + 1]
    assert {composed()[name]["environment"]["TRIFARM_PHYSICS"] for name in ("api", "dispatcher")} == {told}


@pytest.mark.parametrize("service", ["api", "dispatcher"])
def test_every_setting_of_the_services_can_be_set_for_the_containers(service):
    named = set(composed()[service]["environment"])
    wanted = {f"TRIFARM_{field.upper()}" for field in set(Settings.model_fields) - OF_FLAGS - OF_A_PROXY - OF_ROUTERS}
    assert named == wanted


def test_a_router_has_nothing_that_signs_reports_or_speaks_for_anybody():
    for where, _, arguments, variables in containers():
        if arguments[0] == "router":
            assert {"TRIFARM_BUS_KEY", "TRIFARM_BUS_ROBOTS", "TRIFARM_FARM"} <= variables, where
            assert not variables & {"TRIFARM_FARM_KEY", "TRIFARM_ADMIN_TOKEN", "TRIFARM_ROBOT_TOKEN"}, where


def test_on_kubernetes_two_routers_know_each_other_and_all_others_know_both():
    (router,) = (each for each in resources() if each["kind"] == "StatefulSet" and each["metadata"]["name"] == "router")
    told = {row["name"]: row.get("value") for row in router["spec"]["template"]["spec"]["containers"][0]["env"]}
    names = [f"router-{number}" for number in range(router["spec"]["replicas"])]
    all_of_them = tuple(f"tls/{name}.{router['spec']['serviceName']}:7447" for name in names)
    for name, own in zip(names, all_of_them, strict=True):
        addresses = told["TRIFARM_BUS_ADDRESSES"].replace("$(POD)", name)
        settings = Settings(bus="tls/0.0.0.0:7447", bus_addresses=addresses, bus_routers=told["TRIFARM_BUS_ROUTERS"])
        assert settings.bus_endpoints == (own,)
        assert settings.other_routers == tuple(each for each in all_of_them if each != own)
    for where, _, arguments, _ in containers():
        if where in {"api", "dispatcher"}:
            assert parsed(arguments)[1].elsewhere == parsed(arguments)[1].bus_endpoints == all_of_them
    policy = next(each for each in resources() if each["kind"] == "NetworkPolicy" and each["metadata"]["name"] == "router")
    assert {"podSelector": {"matchLabels": {"app": "router"}}} in [to for rule in policy["spec"]["egress"] for to in rule["to"]]


def test_router_and_services_are_told_the_same_of_the_bus():
    router, api = composed()["router"]["environment"], composed()["api"]["environment"]
    alike = {"TRIFARM_FARM", "TRIFARM_BUS_ADDRESSES", "TRIFARM_BUS_ROBOTS"}
    assert {name: router[name] for name in alike} == {name: api[name] for name in alike}


def test_what_a_farm_sets_beside_the_file_reaches_its_containers(tmp_path):
    if shutil.which("docker-compose") is None:
        pytest.skip("docker-compose, which renders the compose file, is not installed")
    needed = ("ADMIN_TOKEN", "ROBOT_TOKEN", "KEY", "FARM_KEY", "BUS_KEY")
    told = {f"TRIFARM_{name}": "secret" for name in needed} | {
        "TRIFARM_WEBHOOKS": "true",
        "TRIFARM_BUS_ROBOTS": "7",
        "PHYSICS": "nominal",
    }
    (tmp_path / ".env").write_text("".join(f"{name}={value}\n" for name, value in told.items()))
    shutil.copy(ROOT / "docker-compose.yml", tmp_path)
    plain = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    done = subprocess.run(["docker-compose", "config"], cwd=tmp_path, env=plain, capture_output=True, text=True, check=True)
    made = {name: inside.get("environment", {}) for name, inside in yaml.safe_load(done.stdout)["services"].items()}
    assert (made["api"]["TRIFARM_WEBHOOKS"], made["api"]["TRIFARM_PHYSICS"]) == ("true", "nominal")
    assert str(made["api"]["TRIFARM_BUS_ROBOTS"]) == str(made["router"]["TRIFARM_BUS_ROBOTS"]) == "7"
    assert made["api"].get("TRIFARM_STUDIES") is None  # as usual, which an empty word would not be


def test_nobody_is_root_in_the_images():
    stages = re.split(r"^FROM ", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)[1:]
    last = {re.search(r" AS (\S+)", stage)[1]: re.findall(r"^USER (\S+)", stage, re.MULTILINE)[-1:] for stage in stages}
    assert {name: last[name] for name in ("s3", "api", "robot")} == {"s3": ["10001"], "api": ["trifarm"], "robot": ["trifarm"]}


UNITS = sorted((ROOT / "deploy/systemd").glob("*.service"))


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_units_start_programs_with_what_they_take(unit, monkeypatch):
    (command,) = re.findall(r"^ExecStart=(.*)$", unit.read_text(), re.MULTILINE)
    _python, _alone, _module, program, *arguments = command.split()
    if program == "services":
        command, settings = parsed(arguments)
        assert (
            command == "serve"
            and str(settings.data) == "/var/lib/trifarm"
            and settings.bus.startswith("unixsock-stream//var/lib")
        )
    else:
        monkeypatch.setenv(TOKEN_VARIABLE, "token")
        assert program == "robot_farm" and parse(arguments).robot_names


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_units_are_of_the_form_that_systemd_reads(tmp_path):
    for unit in UNITS:
        # The program that they name is not installed on the machine of the tests.
        (tmp_path / unit.name).write_text(re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", unit.read_text(), flags=re.MULTILINE))
    command = ["systemd-analyze", "verify", *map(str, sorted(tmp_path.glob("*.service")))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "trifarm" not in done.stderr, done.stderr
