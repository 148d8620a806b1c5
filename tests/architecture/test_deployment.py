"""What is deployed is of the right form, starts programs with flags that they have, and gives nobody root."""

import re
import shutil
import subprocess
from pathlib import Path

import kubernetes_validate
import pytest
import yaml

from robot_farm.settings import TOKEN_VARIABLE, parse
from services.__main__ import parsed
from services.settings import Settings

ROOT = Path(__file__).parents[2]
KUBERNETES = ROOT / "deploy/kubernetes"
VERSION = "1.30"
OF_ROBOTS = {"TRIFARM_ROBOT_TOKEN", "TRIFARM_FARM_SEED"}


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
    assert {"Namespace", "Deployment", "StatefulSet", "Service"} == {each["kind"] for each in found}
    for each in found:
        kubernetes_validate.validate(each, VERSION, strict=True)


def test_what_is_not_of_that_form_is_found():
    broken = next(each for each in resources() if each["kind"] == "Deployment")
    broken["spec"]["replica"] = broken["spec"].pop("replicas")
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, VERSION, strict=True)


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


def test_the_services_are_told_the_physics_of_the_robots():
    robot = composed()["robot"]["command"]
    told = robot[robot.index("--physics") + 1]
    assert {composed()[name]["environment"]["TRIFARM_PHYSICS"] for name in ("api", "dispatcher")} == {told}


def test_nobody_is_root_in_the_images():
    stages = re.split(r"^FROM ", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)[1:]
    last = {re.search(r" AS (\S+)", stage)[1]: re.findall(r"^USER (\S+)", stage, re.MULTILINE)[-1:] for stage in stages}
    assert {name: last[name] for name in ("s3", "api", "robot")} == {"s3": ["10001"], "api": ["trifarm"], "robot": ["trifarm"]}
