"""A log of ours in readers of other people, where they are installed (``tests/readers/reading.py`` says how)."""

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from tests.readers import reading


@pytest.fixture(scope="module")
def counted(short_log):
    """Messages of each topic and entities of its scenes, as the Python library of MCAP has them."""
    topics, entities = {}, 0
    with short_log.open("rb") as stream:
        for schema, channel, _, message in make_reader(
            stream, decoder_factories=[DecoderFactory(), Json()]
        ).iter_decoded_messages():
            topics[channel.topic] = topics.get(channel.topic, 0) + 1
            entities += len(message.entities) if schema.name == "foxglove.SceneUpdate" else 0
    assert entities > 10
    return topics, entities


class Json:
    """Leaves messages in JSON as they are."""

    def decoder_for(self, encoding, _schema):
        return bytes if encoding == "json" else None


def test_rerun_converts_a_log_with_its_scene(short_log, counted):
    if (executable := reading.rerun_executable()) is None:
        pytest.skip("rerun is not installed (pip install rerun-sdk elsewhere, TRIFARM_RERUN=.../bin/rerun): it reads no log here")
    topics, entities = counted
    found = reading.by_rerun(executable, short_log)
    assert (found["check_exit_code"], found["convert_exit_code"], found["errors"]) == (0, 0, [])
    assert found["scene_entities"] == entities
    assert topics.keys() <= found["rows"].keys()


def test_the_go_library_finds_nothing_wrong_with_a_log(short_log, counted):
    if (executable := reading.doctor_executable()) is None:
        pytest.skip("TRIFARM_MCAP_DOCTOR names no program made of tests/readers/doctor.go: the Go library reads no log here")
    topics, entities = counted
    found = reading.by_go(executable, short_log)
    assert (found["problems"], found["per_topic"], found["scene_entities"]) == ([], topics, entities)
    assert (found["attachments"], found["metadata"]) == (2, 2)
