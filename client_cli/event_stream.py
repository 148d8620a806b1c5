"""Server-sent events as lines become job events; pure, so that it can be tested without a server."""

from collections.abc import Iterable, Iterator

from api_schemas.job import JobEvent


def job_events(lines: Iterable[str]) -> Iterator[JobEvent | None]:
    """The events in ``lines`` (without line ends); None for a comment, which is how the server says that it is alive."""
    data: list[str] = []
    for line in lines:
        if line.startswith(":"):
            yield None
        elif line.startswith("data:"):
            data.append(line[5:].removeprefix(" "))
        elif not line and data:
            yield JobEvent.model_validate_json("\n".join(data))
            data = []
