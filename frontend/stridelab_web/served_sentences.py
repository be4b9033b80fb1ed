"""Sentences of the service that the pages translate; all others are shown in English, marked as such.

``%(name)s`` stands for a value. They are those that a person sees at every walk: states of a job, verdicts on sensors,
what a recording cannot give, and the usual remarks.
"""

from typing import Final

PROGRESS: Final = (
    "waiting again",
    "its process was killed; waiting again",
    "its worker was lost; waiting again",
    "cancelling",
    "cancelled",
    "done",
    "reading the recording",
    "placing the body segments",
    "comparing the clocks of force and markers",
    "fusing markers and force",
    "smoothing the geometry",
    "estimating the centre of mass",
    "fitting the wheel of every step",
    "running %(number)s estimators",
    "recording markers and plates",
    "writing the recording",
    "reading it back",
    "writing the result",
    "writing the tables",
    "writing the report",
    "reading the file",
    "unpacking",
)
"""What a job does, beside its bar."""
VERDICTS: Final = (
    "Sensors agree",
    "Doubtful: %(checks)s",
    "Sensors contradict each other: %(checks)s",
    "Certified",
    "Certified; replay completed",
    "Not certified: %(checks)s",
)
"""Verdicts on the result of a job."""
NOT_POSSIBLE: Final = (
    "no force was used",
    "the interval with all force is shorter than 1 s",
    "the interval with all force is too short",
    "only the smoother has innovations",
    "no force channel varies enough for half a second",
    "the body does not walk for half a second, or its segments are hidden",
    "no frame has both force and geometry",
    "no stretch has both force and geometry",
    "no flight of 50 ms is in the interval with all force",
    "no static trial stands still on the plates",
    "the feet are not marked, or no plate carries them",
    "no plate with corners of its own is loaded",
)
"""Why a check of the sensors was not possible."""
REFUSALS: Final = (
    (
        "The recording has no force plate, so no force can be fused with the markers. The method geometry gives the "
        "centre of mass from the markers alone."
    ),
    "All force plates of this recording are switched off.",
    "The force plates of this recording are never loaded.",
    "The recording has only one frame: it can serve as a static trial.",
    "The recording lasts %(duration)s s; at least %(least)s s are needed.",
    (
        "The body mass is neither stated nor in the file, and no force is measured for long enough to weigh the "
        "person. The method geometry needs no mass."
    ),
)
"""Why a method is not possible for a recording."""
REMARKS: Final = (
    "The feet stand still: the stated belt speeds are not used.",
    "The feet stand on a surface that moves at %(speed)s m/s: taken for a treadmill.",
    "These labels occur twice; the more visible is used: %(names)s.",
    "%(number)s points without a name were left out.",
    "Rebuilt from their rigid neighbours: %(names)s.",
    "Short gaps of %(number)s markers were interpolated (%(samples)s samples).",
    "No mass is stated; the plates measure %(mass)s ± %(sd)s kg over %(trials)s trials of the session.",
    (
        "The sex of the subject is not stated: the mean of the female and the male body is used (costs about "
        "%(horizontal)s mm horizontally and %(vertical)s mm vertically)."
    ),
    "The plate %(name)s is never loaded and was left out.",
    "The centre of mass is that of the markers alone: %(reason)s",
    "Not every check of this recording passes. %(reasons)s",
    "The sensors contradict each other; do not use these numbers. %(reasons)s",
)
"""Usual remarks on a recording or on a result."""
_SHOWN: Final = (
    "The force shows %(rank)s of %(numbers)s numbers of the motion (position, velocity and acceleration along three "
    "axes), force and markers together %(together)s of %(all)s (with the table's offset): the height comes from the "
    "markers and the segment table alone, because moving the body along the contact force (here "
)
OBSERVABILITY: Final = (
    _SHOWN + "upright) changes nothing on the plates.",
    _SHOWN + "up to %(tilt)s degrees off the vertical) changes nothing on the plates.",
    (
        "There is no ground contact (free fall): the force shows %(rank)s of %(numbers)s numbers of the motion, its "
        "acceleration; position and velocity come from the markers alone."
    ),
)
"""What the force cannot show."""
CHECKS: Final = (
    "force tilt",
    "normalised innovations",
    "force residual",
    "acceleration difference",
    "channel gain",
    "channel exchange",
    "horizontal bias",
    "vertical bias",
    "largest difference",
    "mass from motion",
    "mass from standing",
    "flight acceleration",
    "pressure from feet",
    "pressure off plate",
    "outside body",
    "leg length change",
    "body proportions",
    "model leg mass",
)
"""Checks of the sensors as verdicts list them, in place of ``%(checks)s``."""
SERVED: Final = (*PROGRESS, *VERDICTS, *NOT_POSSIBLE, *REFUSALS, *OBSERVABILITY, *REMARKS)
"""All of them; the scripts of the pages translate them as well."""
