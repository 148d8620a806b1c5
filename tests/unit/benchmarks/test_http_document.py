"""The comparison of two HTTP documents names each difference once."""

import copy

import pytest

from tests.benchmarks.http_document import differences

OLD = {
    "info": {"version": "1"},
    "paths": {
        "/v1/jobs": {
            "get": {
                "summary": "Jobs",
                "parameters": [{"name": "limit", "in": "query", "schema": {"maximum": 200}}, {"name": "state", "in": "query"}],
                "responses": {"200": {"description": "Fine"}},
            }
        }
    },
    "components": {"schemas": {"Job": {"required": ["seed", "task"], "properties": {"title": {"type": "string"}}}}},
}


def changed(change):
    new = copy.deepcopy(OLD)
    change(new)
    return new


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda new: new["info"].update(version="2"), []),
        (lambda new: new["paths"]["/v1/jobs"]["get"]["parameters"].reverse(), []),
        (lambda new: new["paths"]["/v1/jobs"]["get"].update(summary="All jobs"), []),
        (
            lambda new: new["paths"]["/v1/jobs"]["get"]["parameters"].pop(),
            ['- paths /v1/jobs get parameters query parameter state: {"in": "query", "name": "state"}'],
        ),
        (
            lambda new: new["paths"]["/v1/jobs"]["get"]["parameters"][0]["schema"].update(maximum=100),
            ["! paths /v1/jobs get parameters query parameter limit schema maximum: 200 -> 100"],
        ),
        (
            lambda new: new["components"]["schemas"]["Job"]["required"].remove("seed"),
            ["- components schemas Job required seed"],
        ),
        (
            lambda new: new["components"]["schemas"]["Job"]["properties"].pop("title"),
            ['- components schemas Job properties title: {"type": "string"}'],
        ),
    ],
)
def test_each_difference_is_named_once(change, said):
    assert list(differences(OLD, changed(change))) == said


def test_words_are_compared_if_asked_for():
    new = changed(lambda new: new["paths"]["/v1/jobs"]["get"].update(summary="All jobs"))
    assert list(differences(OLD, new, words=True)) == ['! paths /v1/jobs get summary: "Jobs" -> "All jobs"']
