import hashlib
import json

import pytest
from pydantic import ValidationError

from api_schemas.policy import LAYOUTS, OBSERVATION_SIZES, PolicyManifest, canonical_json, policy_digest

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
