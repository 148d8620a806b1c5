"""Images that a log keeps, without reading anything else of it."""

from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from trial_logs import trial_log
from trial_logs.reader import LogUnreadableError


@dataclass(frozen=True)
class KeptImage:
    """One camera's image: ``camera`` counts in the order of ``trial_log.CAMERA_NAMES``, ``step`` is when it was exposed."""

    camera: int
    step: int
    jpeg: bytes


def read_images(path: Path) -> tuple[KeptImage, ...]:
    """All images of a log in order of time; none where its job did not ask for them.

    Raises:
        LogUnreadableError: the file is missing or no MCAP file that was written to its end.
    """
    places = {topic: camera for camera, topic in enumerate(trial_log.IMAGES)}
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            return tuple(
                KeptImage(places[channel.topic], message.log_time // trial_log.STEP_NS, bytes(image.data))
                for _, channel, message, image in reader.iter_decoded_messages(topics=list(places))
            )
    except Exception as error:  # the border to foreign bytes: decoders raise errors of many libraries
        raise LogUnreadableError(f"{path.name} cannot be read as a trial log: {error or type(error).__name__}") from error
