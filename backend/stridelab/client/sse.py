"""Server-sent events of a job: lines in, events out."""

from pydantic import ValidationError

from stridelab.client.errors import ClientError
from stridelab.schemas.jobs import JobEvent


class EventReader:
    """Puts the lines of a stream together to events; ``last_id`` is where to resume."""

    def __init__(self) -> None:
        self.last_id: str | None = None
        self._id: str | None = None
        self._data: list[str] = []

    def reset(self) -> None:
        """Forget half an event: the stream was cut off."""
        self._id, self._data = None, []

    def feed(self, line: str) -> JobEvent | None:
        """The event that ``line`` completes, or None. Raises ``ClientError`` for one that cannot be read."""
        if line == "":
            data, self._data = "\n".join(self._data), []
            if not data:
                return None
            try:
                event = JobEvent.model_validate_json(data, extra="ignore")
            except ValidationError as error:
                raise ClientError("the service sent an event that this client does not understand") from error
            self.last_id = self._id or self.last_id
            return event
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "data":
            self._data.append(value)
        elif name == "id":
            self._id = value
        return None
