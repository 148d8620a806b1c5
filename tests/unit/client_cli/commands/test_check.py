"""``trifarm check`` with the server's real checks: what it prints and how it ends."""

import json

import numpy as np
import pytest
import safetensors.numpy

from api_schemas.policy import canonical_json, policy_digest
from client_cli.main import run
from tests.hostile.corpus import pickles
from tests.hostile.valid import MANIFEST, SIZE, VALID
from tests.integration.farm_process import sha256


def checked(capfd, *arguments):
    with pytest.raises(SystemExit) as ended:
        run(["check", *map(str, arguments), "--no-try"])
    said = capfd.readouterr()
    return ended.value.code, said.out, said.err


def file(folder, name, content):
    path = folder / name
    path.write_bytes(content)
    (folder / "manifest.json").write_text(canonical_json(MANIFEST))
    return path, "--manifest", folder / "manifest.json"


@pytest.mark.parametrize("kind", VALID)
def test_a_policy_that_would_be_accepted(kind, capfd, tmp_path):
    content = VALID[kind]()
    code, out, _ = checked(capfd, *file(tmp_path, f"p.{kind}", content), "--json")
    verdict = json.loads(out)
    assert (code, verdict["accepted"], verdict["problem"]) == (0, True, None)
    assert verdict["digest"] == policy_digest(sha256(content), MANIFEST)
    assert (verdict["weights_format"], verdict["weights_bytes"]) == (kind, len(content))


def test_people_are_told_in_a_line(capfd, tmp_path):
    code, out, err = checked(capfd, *file(tmp_path, "P.ZIP", VALID["zip"]()))
    assert (code, err) == (0, "")
    assert out.startswith("P.ZIP would be accepted as policy ")


@pytest.mark.parametrize("name", ["pickle in policy.pth", "pickle named pt", "TorchScript"])
def test_a_policy_that_would_be_refused(name, capfd, tmp_path):
    case = pickles(tmp_path / "canary", 1)[name]
    given = file(tmp_path, case.filename, case.content)
    code, out, err = checked(capfd, *given)
    assert (code, out) == (5, "")
    assert f"`trifarm pack {case.filename}`" in err
    code, out, _ = checked(capfd, *given, "--json")
    problem = json.loads(out)["problem"]
    assert code == 5
    assert (problem["type"], problem["status"], problem["file"]) == (f"/problems/{case.slug}", 422, case.filename)
    assert not (tmp_path / "canary").exists()


def test_the_dry_run_is_part_of_the_verdict(capfd, tmp_path):
    constant = {"layer0.weight": np.zeros((9, SIZE), np.float32), "layer0.bias": np.full(9, 0.1, np.float32)}
    code, out, err = checked(capfd, *file(tmp_path, "p.safetensors", safetensors.numpy.save(constant)), "--json")
    assert "problem" in json.loads(out), (out, err)
    problem = json.loads(out)["problem"]
    assert (code, problem["type"], problem["part"]) == (5, "/problems/dry-run-constant", "the dry run")


def test_a_layout_that_does_not_fit_is_shown_beside_one_that_does(capfd, tmp_path):
    path, *_ = file(tmp_path, "p.onnx", VALID["onnx"]())
    code, _, err = checked(capfd, path, "--layout", "rrc2022-lift")
    assert code == 5
    rows = [[cell.strip() for cell in line.split(" | ")] for line in err.splitlines()]
    assert ["42-65 goal_keypoints_world_m 24", "42-44 goal_position_world_m 3"] in rows
    assert "the layout rrc2022-push fits" in err


def test_an_absent_file_is_wrong_usage(capfd, tmp_path):
    code, _, err = checked(capfd, tmp_path / "absent.onnx", "--layout", "pose")
    assert (code, "there is no file" in err) == (2, True)
    code, _, err = checked(capfd, tmp_path, "--layout", "pose")
    assert (code, "is a folder" in err) == (2, True)
