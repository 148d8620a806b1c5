"""What is read of a log does not hang on how its file is laid out."""

from dataclasses import fields

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from trial_logs.reader import read_log


def test_a_log_that_somebody_wrote_again_backwards_is_read_the_same(short_log, tmp_path):
    again = tmp_path / "again.mcap"
    with short_log.open("rb") as source, again.open("wb") as out:
        reader, writer = make_reader(source), Writer(out, chunk_size=50_000)
        writer.start()
        schemas, channels = {}, {}
        messages = list(reader.iter_messages())
        for schema, channel, message in reversed(messages):
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schemas[schema.id])
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        for file in reader.iter_attachments():
            writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        writer.finish()
    first, second = read_log(short_log), read_log(again)
    assert len(first.joint_steps) > 900
    for field in fields(first):
        np.testing.assert_equal(getattr(first, field.name), getattr(second, field.name), field.name)
