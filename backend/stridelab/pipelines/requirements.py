"""Requirements of ``estimate-com`` on the request and the recording, with their error messages."""

from collections.abc import Sequence

from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.trial import Trial
from stridelab.recordings import force_windows as measured
from stridelab.recordings.marker_sets import MarkerSetMatch
from stridelab.recordings.recording import Window
from stridelab.schemas.methods import METHODS


def require_method(method: str) -> str:
    """Return ``method``. Raises ``NotEstimable`` (``method-unavailable``) if this version does not have it."""
    if method not in METHODS:
        raise NotEstimable(
            "method-unavailable",
            f"This version has no {method} estimator; it has: {', '.join(METHODS)}.",
            [Fault("method", f"{method} is not available")],
        )
    return method


def require_marker_set(match: MarkerSetMatch, labels: Sequence[str]) -> None:
    """Raise ``NotEstimable`` (``unknown-marker-set``) with the labels and the missing markers of the closest set."""
    if match.name is not None:
        return
    nearest = ", ".join(f"{name} ({share:.0%} of what it requires)" for name, share in match.nearest)
    faults = [
        Fault(f"nearest set {name}", f"missing: {', '.join(match.needed.get(name, ()))}")
        for name, _ in match.nearest[:1]
    ]
    faults.append(Fault("labels found", ", ".join(labels) or "none"))
    raise NotEstimable(
        "unknown-marker-set",
        f"The {len(labels)} marker labels belong to no known marker set; nearest: {nearest or 'none'}. "
        "Map the labels to landmarks to use this recording.",
        faults,
    )


def require_windows(trial: Trial, window_s: tuple[float, float] | None, *, needs_force: bool) -> tuple[Window, ...]:
    """The windows to use: the measured ones, or the requested interval.

    Raises ``NotEstimable`` (``single-frame``, ``no-plates``, ``plates-switched-off``, ``plates-unloaded``,
    ``forces-and-markers-apart``, ``no-measured-window``) where no force can be used, ``InvalidInput``
    (``window-outside-recording``, ``window-not-measured``) where the requested interval is not inside the recording or
    a measured window.
    """
    if needs_force and not trial.windows:
        measured.require_windows(trial.recording, trial.match.landmarks, trial.motion, stated_kg=trial.stated_kg)
    if window_s is None:
        return trial.windows
    start_s, end_s = window_s
    frame_s = 1.0 / trial.recording.marker_rate_hz
    duration_s = trial.recording.duration_s
    if not -frame_s <= start_s < end_s <= duration_s + frame_s:
        raise InvalidInput(
            "window-outside-recording",
            f"The recording lasts from 0 to {duration_s:.2f} s; there is no interval from {start_s:g} to {end_s:g} s.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    whole = (Window(0.0, duration_s),)
    allowed = trial.windows if needs_force else whole
    if not any(w.start_s - frame_s <= start_s < end_s <= w.end_s + frame_s for w in allowed):
        listed = ", ".join(f"{w.start_s:.2f} to {w.end_s:.2f} s" for w in allowed)
        raise InvalidInput(
            "window-not-measured",
            f"The interval from {start_s:g} to {end_s:g} s is not inside a window in which all contact force is "
            f"measured; there is: {listed}.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    return (Window(start_s, end_s),)
