"""What is wrong with a value is said in a sentence, not in the words of the library that found it."""

import pytest
from pydantic import ValidationError

from api_schemas.job import POLICY_TASKS, JobRequest, TaskName
from api_schemas.policy import PolicyManifest
from client_cli.terminal.options import AskedTask
from client_cli.terminal.wrong_values import meant, sentence, with_meant

JOB = {"policy": "0" * 64, "task": "push"}
MANIFEST = {"observation": ["joint_position_rad"]}


def said(schema, **wrong):
    with pytest.raises(ValidationError) as error:
        schema.model_validate((JOB if schema is JobRequest else MANIFEST) | wrong)
    return sentence(error.value, "the whole")


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"trials": -1}, "trials is -1 and should be greater than or equal to 1"),
        ({"webhook": "ftp://x"}, "webhook: a webhook's address begins with https:// and a host, this one with 'ftp://x'"),
        ({"colour": "red"}, "colour is not known there"),
        ({"object": "x" * 99}, f"object is '{'x' * 58}… and should be 'cube', 'cuboid', 'sphere' or 'octagonal_prism'"),
    ],
)
def test_a_wrong_job(wrong, expected):
    assert said(JobRequest, **wrong) == expected


def test_a_wrong_manifest():
    assert said(PolicyManifest, rate_hz=300).startswith("rate_hz is 300; ")
    with pytest.raises(ValidationError) as error:
        PolicyManifest.model_validate({})
    assert sentence(error.value, "it") == "observation is missing"


def test_the_tasks_that_are_offered_are_those_of_policies(farm, trifarm, tmp_path):
    assert AskedTask.__args__ == POLICY_TASKS
    (tmp_path / "x.onnx").write_bytes(b"weights")
    missing = trifarm("submit", str(tmp_path / "x.onnx"), "--layout", "pose")
    assert missing.code == 2
    assert f"({', '.join(POLICY_TASKS)})" in missing.err
    assert not farm.uploads
    assert TaskName.IDENTIFY not in missing.err
    wrong = trifarm("submit", "x.onnx", "--task", "identify")
    assert wrong.code == 2
    assert "'push'" in wrong.err
    assert "Value error" not in wrong.err


@pytest.mark.parametrize(
    ("flags", "named"),
    [(["--owner", "ann", "--days", "99999999"], "--days is 99999999"), (["--owner", "a b"], "the owner is 'a b'")],
)
def test_what_is_wrong_with_a_token_is_what_is_blamed(trifarm, flags, named):
    ended = trifarm("token", "create", "--scope", "submit", *flags)
    assert ended.code == 2
    assert named in ended.err


def test_numbers_out_of_range_read_as_sentences(trifarm):
    err = trifarm("submit", "x.onnx", "--task", "push", "--trials", "999999").err
    assert "'--trials': it should be less than or equal to 100000" in err


@pytest.mark.parametrize(
    "given, names, told",
    [
        ("pusch", ("push", "lift"), "; did you mean push?"),
        ("PUSH", ("push", "lift"), "; did you mean push?"),
        ("rael", ("nominal", "mild", "real"), "; did you mean real?"),
        ("xyzzy", ("push", "lift"), ""),
        (
            "rrc2022-flat",
            ("rrc2022-lift", "rrc2022-push-flat", "rrc2022-lift-flat"),
            "; did you mean rrc2022-push-flat or rrc2022-lift-flat?",
        ),
    ],
)
def test_a_name_that_is_nearly_right_is_recognised(given, names, told):
    assert meant(given, names) == told
    listed = ", ".join(f"'{name}'" for name in names)
    assert with_meant(f"'{given}' is not one of {listed}.") == f"'{given}' is not one of {listed}" + (told or "")


def test_other_messages_stay_as_they_are():
    assert with_meant("it should be greater than 0.") == "it should be greater than 0."
