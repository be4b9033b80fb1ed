"""Parts of robots in words, as the field names them."""

import re
from typing import Final

_NUMBERED: Final = re.compile(
    r"(?P<part>leg|arm)_(?P<side>left|right)_(?P<number>\d)|(?P<s>[LR])(?P<p>LEG|ARM)_\D*(?P<n>\d)"
)
"""Names of joints and links that count from the trunk: from 1 as TALOS', from 0 as HRP-2's."""
_NUMBERED_PARTS: Final = {
    "leg": ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll"),
    "arm": ("first shoulder", "second shoulder", "upper arm", "elbow", "forearm", "first wrist", "second wrist"),
}


def part_words(name: str) -> str:
    """An effector, joint or link in words: ``leg_left_4_joint`` is "left knee", ``waist_yaw_link`` "waist yaw"."""
    if match := _NUMBERED.match(name):
        counted_from_1 = match["part"] is not None
        names = _NUMBERED_PARTS[match["part"] if counted_from_1 else match["p"].lower()]
        side = match["side"] if counted_from_1 else {"L": "left", "R": "right"}[match["s"]]
        number = int(match["number"]) - 1 if counted_from_1 else int(match["n"])
        if 0 <= number < len(names):
            return f"{side} {names[number]}"
    bare = re.sub(r"_(?:joint|link)(\d*)(?:_\d+)?(?: \(visual\))?$", r" \1", name, flags=re.IGNORECASE)
    return bare.replace("_", " ").strip().lower()
