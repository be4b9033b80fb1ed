"""Text fields of the upload form: the subject and the session, as stated by the user."""

from collections.abc import Mapping
from typing import Final

from pydantic import ValidationError

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.recordings import RecordingPatch, SubjectFields

FORM_TO_FIELD: Final[Mapping[str, str]] = {
    "subject_name": "name",
    "height_m": "height_m",
    "mass_kg": "mass_kg",
    "sex": "sex",
    "age_years": "age_years",
}
SESSION: Final = "session_id"
_HINTS: Final[Mapping[str, str]] = {
    "height_m": "stature in metres, from 0.4 to 2.6 (171 cm is 1.71)",
    "mass_kg": "body mass in kilograms, from 2 to 400",
    "sex": "'female', 'male' or empty",
    "age_years": "age in years, from 0 to 120",
    "subject_name": "a pseudonym of at most 80 characters",
}


def subject_of_form(fields: Mapping[str, str]) -> SubjectFields:
    """The stated subject; an empty field counts as not given.

    Raises ``InvalidInput`` (``invalid-request``) naming every unknown or invalid field.
    """
    allowed = {*FORM_TO_FIELD, SESSION}
    faults = [Fault(name[:60], "unknown field") for name in fields if name not in allowed]
    stated = {
        FORM_TO_FIELD[name]: text.strip() for name, text in fields.items() if name in FORM_TO_FIELD and text.strip()
    }
    if not stated.get("name", "").isprintable():
        faults.append(Fault("subject_name", _HINTS["subject_name"]))
        del stated["name"]
    subject = SubjectFields()
    try:
        subject = SubjectFields.model_validate(stated)
    except ValidationError as error:
        field_to_form = {field: name for name, field in FORM_TO_FIELD.items()}
        places = dict.fromkeys(field_to_form[str(item["loc"][0])] for item in error.errors())
        faults += [Fault(place, _HINTS[place]) for place in places]
    if faults:
        names = ", ".join(fault.where for fault in faults)
        raise InvalidInput("invalid-request", f"The form is not valid: see {names}.", faults)
    return subject


def session_of_form(fields: Mapping[str, str]) -> str | None:
    """The stated session; an empty field counts as not given. Raises ``InvalidInput`` (``invalid-request``)."""
    text = fields.get(SESSION, "").strip()
    if not text:
        return None
    try:
        return RecordingPatch(session_id=text).session_id
    except ValidationError as error:
        fault = Fault(SESSION, "1 to 64 letters, digits, dots, underscores and hyphens")
        raise InvalidInput("invalid-request", f"The form is not valid: see {SESSION}.", [fault]) from error
