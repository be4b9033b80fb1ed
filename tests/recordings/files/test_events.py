"""Event dialects and the clock they count from."""

import pytest

from stridelab.recordings.files.metadata import event_kind, event_side, read_events


@pytest.mark.parametrize(
    ("label", "context", "kind", "side"),
    [
        ("Foot Strike", "Left", "foot_strike", "left"),
        ("Foot Strike2", "Right", "foot_strike", "right"),
        ("Foot Off", "Right", "foot_off", "right"),
        ("LHS", "", "foot_strike", "left"),
        ("RTO", "", "foot_off", "right"),
        ("Right Heel Strike", "General", "foot_strike", "right"),
        ("Toe off", "left", "foot_off", "left"),
        ("Initial contact", "", "foot_strike", None),
    ],
)
def test_events_of_every_vendor_are_read(label: str, context: str, kind: str, side: str | None) -> None:
    assert event_kind(label) == kind
    assert event_side(label, context) == side


def test_times_count_from_the_original_recording() -> None:
    """A file cropped to frame 286 (index 285) at 100 Hz: an event at 3.35 s lies 0.5 s into it."""
    (event,) = read_events(["Foot Strike"], ["Left"], [3.35], 285, 100.0)
    assert event.time_s == pytest.approx(0.5)


def test_other_events_are_left_out_and_the_rest_is_in_order_of_time() -> None:
    events = read_events(["Foot Off", "General event", "Foot Strike"], ["Left", "", "Right"], [2.0, 1.0, 0.5], 0, 100.0)
    assert [event.kind for event in events] == ["foot_strike", "foot_off"]


def test_missing_contexts_are_no_error() -> None:
    assert read_events(["LHS", "RTO"], [], [1.0, 2.0], 0, 100.0)[1].side == "right"
