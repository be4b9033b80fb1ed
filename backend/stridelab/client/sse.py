"""Parser of the server-sent events of a job."""

from pydantic import ValidationError

from stridelab.client.errors import ClientError
from stridelab.schemas.jobs import JobEvent


class EventReader:
    """Assembles events from the lines of a stream; ``last_id`` is the event id to resume from."""

    def __init__(self) -> None:
        self.last_id: str | None = None
        self._id: str | None = None
        self._data: list[str] = []

    def reset(self) -> None:
        """Discard an incomplete event, after the stream was interrupted."""
        self._id, self._data = None, []

    def feed(self, line: str) -> JobEvent | None:
        """Process a line; return the event that it completes, or None. Raises ``ClientError`` for an invalid event."""
        if line == "":
            data, self._data = "\n".join(self._data), []
            if not data:
                return None
            try:
                event = JobEvent.model_validate_json(data, extra="ignore")
            except ValidationError as error:
                raise ClientError("the service sent an event that this client cannot parse") from error
            self.last_id = self._id or self.last_id
            return event
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "data":
            self._data.append(value)
        elif name == "id":
            self._id = value
        return None
