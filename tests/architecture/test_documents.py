"""What the documents name exists, and the Makefile stays small."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def rows_of(text, *heads):
    """The cells of the table whose first columns have these heads."""
    head = " | ".join(heads)
    table = re.search(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert table is not None, f"there is no table of {head}"
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[1].splitlines()]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), f"{document.name} links to {target}, which does not exist"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_make_targets_in_documents_exist(document):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for target in re.findall(r"`make ([a-z-]+)`|^make ([a-z-]+)", document.read_text(), re.MULTILINE):
        assert (target[0] or target[1]) in targets


def test_policies_in_the_readme_are_there():
    named = re.findall(r"[\w./-]+\.safetensors", (ROOT / "README.md").read_text())
    assert named
    assert all((ROOT / path).is_file() for path in named)


def test_makefile_has_at_most_ten_targets():
    phony = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony is not None
    assert len(phony.group(1).split()) <= 10


def test_documented_log_channels_are_those_of_the_writer():
    from trial_logs import trial_log

    written = {
        value for value in vars(trial_log).values() if isinstance(value, str) and value.startswith(("/measured/", "/truth/"))
    }
    documented = set(re.findall(r"`(/(?:measured|truth)/[a-z_]+)`", (ROOT / "docs/logs.md").read_text()))
    assert documented == written


def test_documented_layouts_and_manifest_are_valid():
    from api_schemas.policy import LAYOUTS, PolicyManifest

    text = (ROOT / "docs/policies.md").read_text()
    assert [row[0].strip("`") for row in rows_of(text, "layout")] == list(LAYOUTS)
    keypoints, own = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    assert PolicyManifest.model_validate_json(keypoints) == LAYOUTS["keypoints"]
    PolicyManifest.model_validate_json(own)


def test_documented_defaults_are_those_of_the_manifest():
    from api_schemas.policy import InputScaling, OutputScaling, PolicyManifest

    text = (ROOT / "docs/policies.md").read_text()
    rows = {cell.strip("`"): default.strip("`") for cell, default, _ in rows_of(text, "field", "default")}
    more = [(re.match(r'`"(\w+)"', cell), default.strip("`")) for cell, default, _ in rows_of(text, "more fields")]
    rows |= {name[1]: default for name, default in more if name is not None}
    nothing = (None, (), InputScaling(), OutputScaling())
    wanted = {"observation": "needed"}
    for name, field in PolicyManifest.model_fields.items():
        if not field.is_required() and name != "bins":  # which goes with the head
            value = getattr(field.default, "value", field.default)
            wanted[name] = "none" if value in nothing else f"{value:g}" if isinstance(value, float) else str(value)
    assert rows == wanted


def test_documented_joints_are_those_of_the_robot():
    from sim_backend.trifinger import constants as c

    text = (ROOT / "docs/policies.md").read_text()
    rows = [[cell.strip("`").replace("−", "-") for cell in row] for row in rows_of(text, "joint")]
    ranges = [f"{low:g} to {high:g}" for low, high in zip(c.SOFT_LIMIT_LOWER_RAD[:3], c.SOFT_LIMIT_UPPER_RAD[:3], strict=True)]
    axes = ["+" + "xyz"[link.joint_axis.index(1.0)] for link in c.LINKS if link.joint_axis]
    start, damping = ([f"{value:g}" for value in each[:3]] for each in (c.START_JOINT_POSITION_RAD, c.SAFETY_DAMPING_NM_S_RAD))
    assert rows == [list(row) for row in zip(c.JOINT_SUFFIXES, axes, ranges, start, damping, strict=True)]
    gains = f"{c.POSITION_GAIN_NM_RAD[0]:g} N m/rad × (target − position) − {c.VELOCITY_GAIN_NM_S_RAD[0]:g} N m s/rad"
    assert gains in " ".join(text.split())


def test_documented_fields_of_observations_are_all_there_are():
    from api_schemas.observation import OBSERVATION_SIZES

    rows = rows_of((ROOT / "docs/policies.md").read_text(), "field", "numbers")
    assert {name.strip("`"): int(size) for name, size, _ in rows} == OBSERVATION_SIZES


def test_documented_tasks_are_all_there_are():
    from sim_backend.tasks import TASKS

    rows = {name.strip("`"): cells for name, *cells in rows_of((ROOT / "docs/policies.md").read_text(), "task")}
    assert {name: lasts for name, (lasts, *_) in rows.items()} == {name: f"{task.duration_s:g} s" for name, task in TASKS.items()}
    turned = {name for name, (*_, near) in rows.items() if "22°" in near}
    assert turned == {name for name, task in TASKS.items() if task.orientation_counts}


@pytest.mark.parametrize("name", ["docs/scale.md", "docker-compose.yml"])
def test_settings_in_documents_and_containers_exist(name):
    from services.settings import Settings

    # of the command line, of the compose file itself, and of robots
    outside = {"TRIFARM_URL", "TRIFARM_TOKEN", "TRIFARM_KEY", "TRIFARM_FARM_SEED", "TRIFARM_CA"}
    named = set(re.findall(r"\bTRIFARM_[A-Z0-9_]+", (ROOT / name).read_text())) - outside
    assert named
    assert named <= {f"TRIFARM_{field.upper()}" for field in Settings.model_fields}


def test_documented_detection_limits_are_those_that_are_used():
    text = (ROOT / "docs/detection-limits.md").read_text()
    joints = json.loads((ROOT / "sim_backend/reality_gap/knowledge/detection_limits.json").read_text())["limits"]
    cube = json.loads((ROOT / "sim_backend/reality_gap/knowledge/healthy_cubes.json").read_text())["limits"]
    sides = {"": "", ".down": ", below nominal", ".up": ", above nominal"}
    used = [(f"`{name}`", f"{value:.3g}") for name, value in joints.items()]
    for key, value in cube.items():
        name = key.partition(".")[0]
        used.append((f"`{name}`{sides[key.removeprefix(name)]}", f"{value:.3g}"))
    documented = re.findall(r"^\| (`[a-z0-9_.]+`(?:, \w+ nominal)?) \| ([-0-9.e]+) \|", text, re.MULTILINE)
    assert documented == used
