"""Shared by the public functions: validation of options and data frames."""

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any, TypeVar

from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput, Unavailable
from stridelab.schemas.base import Contract

Model = TypeVar("Model", bound=Contract)
Progress = Callable[[float, str], None]
"""Called with a fraction from 0 to 1 and a message."""


def ignore_progress(_fraction: float, _message: str) -> None:
    """Ignore the progress."""


def validate_fields(model: type[Model], fields: Any) -> Model:
    """Instance of a contract model. Raises ``InvalidInput`` (``option-invalid``) naming each invalid field."""
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        faults = [Fault(".".join(str(part) for part in e["loc"]), e["msg"]) for e in error.errors()]
        raise InvalidInput("option-invalid", "; ".join(f"{f.where}: {f.message}" for f in faults), faults) from error


def data_frame(columns: Mapping[str, Any]) -> Any:
    """A pandas data frame, else a polars one. Raises ``Unavailable`` (``dataframe-unavailable``) without either."""
    for name in ("pandas", "polars"):
        if find_spec(name) is not None:
            return import_module(name).DataFrame(dict(columns))
    raise Unavailable("dataframe-unavailable", "Install pandas or polars for data frames.")
