"""Sentences of the service on recordings that are left out or used with a remark, translated as ``ON_PAGES`` is.

``%(name)s`` stands for a value; see ``served_sentences``.
"""

from typing import Final

LEFT_OUT: Final = (
    (
        "This is no straight walk on level ground: In %(duration)s s no foot is lifted and the pelvis moves by "
        "%(way)s m."
    ),
    (
        "This is no straight walk on level ground: the ground is not level. The feet stand at heights of "
        "%(heights)s m (lowest marker), up to %(apart)s m apart from one to the next."
    ),
    (
        "This is no straight walk on level ground: it is running. %(flights)s of %(number)s steps have a flight, "
        "of %(time)s ms (median), in place of a double support."
    ),
    (
        "This is no straight walk on level ground: it is running. In the middle of the stance the pelvis is "
        "%(depth)s mm lower than at its ends (median); in walking it is higher there."
    ),
    (
        "This is no straight walk on level ground: the walk is not straight. From %(part_each)s the pelvis goes "
        "towards %(directions)s degrees from the first, %(turn)s degrees in all."
    ),
    "stride to stride",
    "step to step",
    (
        "This is no straight walk on level ground: the person walks %(part_way)s. The feet point %(angle)s "
        "degrees away from the direction of the walk."
    ),
    "backwards",
    "sideways",
    "Height or body mass differ between the recordings more than those of one person do: report people one by one.",
    (
        "The recordings have speeds from %(low)s to %(high)s m/s. Most measures depend on the speed: report the "
        "conditions one by one."
    ),
    "This is the static trial of the other recordings, without steps.",
    "This is the same file as %(name)s: a recording counts once.",
    "The same file as %(name)s: a recording counts once.",
    "%(name)s is the same file as %(other)s: a recording counts once.",
    "The sensors of this recording contradict each other. %(reasons)s",
    "No recording has a whole step that can be measured.",
    "The recording contains no whole step of a marked foot.",
    "The recording shows no marker at any time (%(part_what)s).",
    "which are interpolated.",
    "no labelled marker",
    "only NaN",
    "%(number)s samples of %(source)s are missing in gaps of at most %(gap)s ms, %(part_use)s",
    (
        "The plates have other axes than the markers: their vertical is the %(plates)s axis of the file, the body"
        " stands along its %(body)s axis. The plates were turned; the centre of pressure now lies %(distance)s cm"
        " from the nearest foot marker (median)."
    ),
    (
        "The body extends from feet to pelvis along the %(body)s axis of the file; the vertical is its %(plates)s"
        " axis, that of the plates. Unless the person lies down, markers and plates have different axes."
    ),
    "The feet stand on a surface that moves at %(speed)s m/s, which the stated belt speeds contradict.",
    (
        "No force plate of this recording can be used: under no unit does a centre of pressure lie on its plate. "
        "The method geometry gives the centre of mass from the markers alone."
    ),
    "At no time is all contact force measured. %(part_why)s",
    "Whenever a plate is loaded, a foot, or a part of one, stands beside the plates.",
    "Forces and markers do not overlap: the plates are loaded %(span_loaded)s, the markers are seen %(span_seen)s.",
    "The markers are named by the static trial, whose set is %(name)s: %(labels)s.",
    "Markers that move with a segment in both trials carry the landmarks of the static trial: %(clusters)s.",
    (
        "The marker set of the static trial %(file)s is not recognised: only the %(number)s landmarks that it "
        "shares with this recording, or that were mapped, are used."
    ),
    "The stated mass of %(mass)s kg contradicts the plates: %(list_masses)s.",
    (
        "The motions measured by the markers and by the plates agree best when one is shifted by %(time)s ms or "
        "more: clocks do not differ by that much, so their delay cannot be determined."
    ),
    "The ankles are not marked, nor heel and fifth metatarsal from which to place them.",
    "No step (lift-off to the next lift-off) lies entirely inside the time in which the centre of mass is known.",
    "In none of the recordings could a step be fitted.",
    "Every subject has only one step, so steps do not repeat.",
    "None of the files is a readable recording.",
    "In none of the recordings could the estimators be scored.",
)
"""Why a walk is not measured or a recording not used, and remarks on its plates, axes and static trial."""
