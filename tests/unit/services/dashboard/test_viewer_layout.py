"""The layout for viewers names what logs have."""

import json
import re

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from services.dashboard.pages import FOLDER
from trial_logs import trial_log

LAYOUT = json.loads((FOLDER / "static" / "viewer_layout.json").read_text())
PANELS = LAYOUT["configById"]
PATHS = [path["value"] for panel in PANELS.values() for path in panel.get("paths", [])]


def leaves(place):
    return {place} if isinstance(place, str) else leaves(place["first"]) | leaves(place["second"])


def test_every_panel_has_its_place():
    assert leaves(LAYOUT["layout"]) == set(PANELS)


def test_topics_are_those_of_a_log():
    asked = {*PANELS["3D!scene"]["topics"], PANELS["RosOut!events"]["topicToRender"], *(path.split(".")[0] for path in PATHS)}
    assert asked <= {*trial_log.MEASURED_TOPICS, *trial_log.SHARED_TRUTH_TOPICS}


@pytest.fixture(scope="module")
def first(short_log):
    """The first message of each topic."""
    found = {}
    with short_log.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.topic not in found:
                decoder = json.loads if channel.message_encoding == "json" else DecoderFactory().decoder_for("protobuf", schema)
                found[channel.topic] = decoder(message.data)
    return found


def test_no_frame_of_a_log_is_drawn_as_axes_longer_than_the_robot(short_log):
    with short_log.open("rb") as stream:
        sent = [
            DecoderFactory().decoder_for("protobuf", schema)(message.data)
            for schema, _, message in make_reader(stream).iter_messages(
                [trial_log.MEASURED_TRANSFORMS, trial_log.TRUE_TRANSFORMS]
            )
        ]
    frames = {name for each in sent for f in each.transforms for name in (f.parent_frame_id, f.child_frame_id)}
    hidden = {f"frame:{name}" for name in frames | set(trial_log.CAMERA_NAMES)}
    assert hidden <= {name for name, told in PANELS["3D!scene"]["transforms"].items() if told == {"visible": False}}


def test_every_object_of_the_reports_schema_has_properties(short_log):
    """Foxglove Studio shows nothing of a topic otherwise."""
    with short_log.open("rb") as stream:
        (schema,) = [each for each in make_reader(stream).get_summary().schemas.values() if each.encoding == "jsonschema"]
    told = json.loads(schema.data)
    assert all("properties" in each for each in (told, *told["properties"].values()) if each["type"] == "object")
    assert set(told["properties"]["visible_faces"]["properties"]) == set(trial_log.CAMERA_NAMES)


def test_every_line_of_a_plot_is_a_number_of_a_log(first):
    for path in PATHS:
        topic, *fields = re.findall(r"^/[^.]*|[^.\[\]]+", path)
        value = first[topic]
        for field in fields:
            value = value[int(field)] if field.isdecimal() else value[field] if isinstance(value, dict) else getattr(value, field)
        assert isinstance(value, float), path
