"""CoM of the segment model frame by frame, from labelled markers as they are measured.

The model needs the lengths of bones and the widths of joints, which are medians over a trial. Here they are medians of
*reference frames*: up to ``MAX_REFERENCES`` frames with the most markers visible, spread evenly over the stream so far
(whenever they are full, every second one is dropped and their spacing doubles). The model of a recording is applied to
the reference frames with the current frame as the last, so it fills hidden markers of a rigid cluster as it does there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Points, Vector3
from stridelab.errors import StridelabError
from stridelab.recordings.recording import Recording, Subject

MAX_REFERENCES: Final = 16
FIRST_SPACING_S: Final = 0.1
_NO_BRIDGING_HZ: Final = 1.0
"""Rate of the reference frames as the model sees it: gaps in frames that do not follow each other are not bridged."""

GeometrySource = Literal["measured", "substituted", "none"]


@dataclass(frozen=True)
class PlacedBody:
    """Segment model at one frame; ``com_m`` is None where it cannot be formed, ``reason`` then says why.

    ``sd_m`` includes what substituted landmarks cost. ``hidden`` are the landmarks without a position in this frame.
    """

    com_m: Vector3 | None
    sd_m: tuple[float, float, float]
    joint_centres_m: Mapping[str, Vector3]
    hidden: tuple[str, ...]
    source: GeometrySource
    remarks: tuple[str, ...] = ()
    reason: str | None = None


class MarkerGeometry:
    """Places the body segments at each frame of a stream.

    ``landmarks`` maps a landmark to its label; a frame has one point per landmark, in this order. ``static`` is a trial
    of the same person with ``static_landmarks``, for joint widths and hidden markers.
    """

    def __init__(
        self,
        landmarks: Mapping[str, str],
        subject: Subject,
        static: Recording | None = None,
        static_landmarks: Mapping[str, str] | None = None,
    ) -> None:
        self.landmarks, self._subject = landmarks, subject
        self._static, self._static_landmarks = static, static_landmarks
        self._references: list[Points] = []
        self._most_seen, self._next_s, self._spacing_s = 0, -np.inf, FIRST_SPACING_S
        self.window = self._recording(np.full((1, len(landmarks), 3), np.nan))

    def place(self, time_s: float, points_m: Points, *, may_substitute: bool) -> PlacedBody:
        """Place the segments at a frame; ``points_m`` has NaN for a hidden landmark.

        With ``may_substitute``, landmarks that are hidden now and have no visible neighbours are treated as not marked.
        """
        seen = np.isfinite(points_m).all(axis=1)
        hidden = tuple(name for name, visible in zip(self.landmarks, seen, strict=True) if not visible)
        self.window = self._recording(np.stack([*self._references, points_m]))
        geometric, reason = self._apply_model(self.landmarks)
        source: GeometrySource = "measured"
        if geometric is None and may_substitute and hidden:
            left = {name: label for name, label in self.landmarks.items() if name not in hidden}
            geometric, reason = self._apply_model(left)
            source = "substituted"
        if geometric is None:
            return PlacedBody(None, (np.nan,) * 3, {}, hidden, "none", reason=reason)
        if source == "measured":
            self._update_references(time_s, points_m, int(seen.sum()))
        centres = {name: track[-1] for name, track in geometric.joint_centres_m.items() if np.isfinite(track[-1]).all()}
        codes = tuple(remark.code for remark in geometric.remarks)
        return PlacedBody(geometric.com_m[-1], geometric.sd_m, centres, hidden, source, codes)

    def _apply_model(self, landmarks: Mapping[str, str]) -> tuple[GeometricCom | None, str]:
        """The model over the window, or None and the code of the reason if the last frame has no CoM."""
        try:
            geometric = SegmentModel().com(
                self.window,
                landmarks,
                subject=self._subject,
                static=self._static,
                static_landmarks=self._static_landmarks,
            )
        except StridelabError as error:
            return None, error.code
        return (geometric, "") if np.isfinite(geometric.com_m[-1]).all() else (None, "markers-hidden")

    def _update_references(self, time_s: float, points_m: Points, n_seen: int) -> None:
        if n_seen > self._most_seen:
            self._references, self._spacing_s, self._next_s = [], FIRST_SPACING_S, -np.inf
            self._most_seen = n_seen
        if n_seen < self._most_seen or time_s < self._next_s:
            return
        self._references.append(points_m)
        if len(self._references) > MAX_REFERENCES:
            self._references, self._spacing_s = self._references[::2], 2.0 * self._spacing_s
        self._next_s = time_s + self._spacing_s

    def _recording(self, frames_m: np.ndarray) -> Recording:
        tracks = {label: frames_m[:, k] for k, label in enumerate(self.landmarks.values())}
        return Recording(
            markers_m=tracks,
            marker_rate_hz=_NO_BRIDGING_HZ,
            force_rate_hz=_NO_BRIDGING_HZ,
            plates=(),
            subject=self._subject,
            events=(),
            up_axis="+z",
            walking_direction=None,
        )
