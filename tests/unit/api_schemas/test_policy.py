import hashlib
import json

import pytest
from pydantic import ValidationError

from api_schemas.observation import OBSERVATION_SIZES
from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json, policy_digest

FIELDS = {"observation": ["joint_position_rad"]}


@pytest.mark.parametrize(
    ("name", "size", "period", "delay"),
    [("rrc2022-push", 54, 20, 10), ("rrc2022-lift", 75, 20, 2), ("keypoints", 75, 20, 0), ("pose", 41, 20, 0)],
)
def test_layouts(name, size, period, delay):
    layout = LAYOUTS[name]
    assert (layout.observation_size, layout.period_steps, layout.delay_steps) == (size, period, delay)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_manifest_comes_back_from_its_canonical_form(name):
    text = canonical_json(LAYOUTS[name])
    assert PolicyManifest.model_validate_json(text) == LAYOUTS[name]
    assert canonical_json(PolicyManifest.model_validate_json(text)) == text


def test_the_digest_is_the_documented_hash_and_does_not_depend_on_spelling():
    terse = PolicyManifest.model_validate(FIELDS)
    spelled = PolicyManifest.model_validate(json.loads(canonical_json(terse)))
    expected = hashlib.sha256(f"{'0' * 64}\n{canonical_json(terse)}".encode()).hexdigest()
    assert policy_digest("0" * 64, terse) == policy_digest("0" * 64, spelled) == expected
    assert policy_digest("1" * 64, terse) != expected


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"observation": ["nothing"]}, "choose from"),
        ({"observation": []}, "at least 1"),
        ({"input_scaling": {"clip": float("inf")}}, "finite"),
        ({"output_scaling": {"scale": float("nan")}}, "finite"),
        ({"output_scaling": {"scale": [1e999] * 9}}, "finite"),
        ({"rate_hz": 2}, "greater than or equal to 4"),
        ({"rate_hz": 7}, "multiple of rate_hz"),
        ({"rate_hz": 0}, "greater than"),
        ({"action_delay_s": 0.02}, "shorter than the control period"),
        ({"action_delay_s": 0.0015}, "whole number of milliseconds"),
        ({"activation": "gelu"}, "elu"),
        ({"surprise": 1}, "Extra inputs"),
        ({"format": "trifarm-policy/2"}, "trifarm-policy/1"),
        ({"input_scaling": {"clip": 0}}, "greater than 0"),
    ],
)
def test_manifests_that_cannot_be(change, word):
    with pytest.raises(ValidationError, match=word):
        PolicyManifest.model_validate(FIELDS | change)


def test_every_field_has_a_size():
    everything = PolicyManifest(observation=tuple(OBSERVATION_SIZES))
    assert everything.observation_size == sum(OBSERVATION_SIZES.values())


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("rrc2022-push", "fb7e1f5163c5d177ac62682182e1ec473b0420ab2e20aa0f054c379033e80796"),
        ("rrc2022-lift", "a5a81af66850e8cff79913987ecaac1f479e7a786fd5076effdf9895812b5397"),
        ("keypoints", "65a4bcb5e07f02120deb24bb8b05de90958b509516593c27af8f0fc56abae874"),
        ("pose", "48618f49d74a93b46f0097dd9a9d0248f8e5b36f8026b46cc90f8a944df661c2"),
    ],
)
def test_digests_of_old_manifests_have_not_changed(name, digest):
    assert policy_digest("0" * 64, LAYOUTS[name]) == digest


@pytest.mark.parametrize(
    "change",
    [
        {"frame_stack": {"count": 3}},
        {"recurrent": "gru"},
        {"states": [{"input": "h", "output": "g", "shape": [1, 1, 4]}]},
        {"head": "bins", "bins": 11},
        {"output_scaling": {"squash": "tanh"}},
        {"output_scaling": {"offset": 0.1}},
    ],
)
def test_each_later_field_is_part_of_the_digest(change):
    changed = PolicyManifest.model_validate(FIELDS | change)
    assert policy_digest("0" * 64, changed) != policy_digest("0" * 64, PolicyManifest.model_validate(FIELDS))
    assert PolicyManifest.model_validate_json(canonical_json(changed)) == changed


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"frame_stack": {"count": 1}}, "greater than or equal to 2"),
        ({"head": "bins"}, "give bins with the head"),
        ({"bins": 11}, "give bins with the head"),
        ({"recurrent": "rnn"}, "lstm"),
        ({"states": [{"input": "h", "output": "h", "shape": [4]}]}, "of its own"),
        ({"states": [{"input": "h", "output": "g", "shape": [60_000, 60_000]}]}, "may hold"),
        ({"recurrent": "gru", "states": [{"input": "h", "output": "g", "shape": [4]}]}, "give one of them"),
    ],
)
def test_networks_that_cannot_be(change, word):
    with pytest.raises(ValidationError, match=word):
        PolicyManifest.model_validate(FIELDS | change)
