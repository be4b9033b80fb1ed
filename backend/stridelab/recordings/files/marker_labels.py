"""Selects the markers among a file's points: handles prefixes, unlabelled points, duplicates and model outputs."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from stridelab.recordings.recording import Remark

_NOT_A_POSITION = re.compile(r"(angles?|power|force|moment|grf|index|archheight|ang)(rot)?$", re.IGNORECASE)
_UNLABELLED = re.compile(r"^(\*\d*|[uU]nlabell?ed\W*\d*|)$")
_COMPUTED = re.compile(r"^(centreofmass(floor)?|centerofmass(floor)?|[lr][hkaesw]jc)$", re.IGNORECASE)
_OXFORD_FOOT = re.compile(r"^[LR](AJC|D1M0|(FOF|HDF|HLX)\d|HE1|PROXFF|TIB\d)$")
"""Points that the Oxford Foot Model computes; ``LTIB1`` is one of them only beside its hindfoot frame ``LHDF0``."""
_FRAME_SUFFIXES = ("O", "A", "L", "P")


@dataclass(frozen=True)
class LabelSelection:
    """``column`` maps each selected label to its column in the file; ``outputs`` are those of computed positions."""

    column: dict[str, int]
    outputs: frozenset[str]
    remarks: tuple[Remark, ...]


def without_prefix(label: str) -> str:
    """``Subject:LASI`` -> ``LASI``; the prefix is often a person's name and is never stored."""
    return label.rsplit(":", 1)[-1].strip()


def model_frames(labels: Iterable[str]) -> frozenset[str]:
    """Points of segment frames: four labels that share three letters and end in O, A, L and P (``PELO`` ...)."""
    present = set(labels)
    stems = {label[:-1] for label in present if len(label) == 4 and label.endswith("O")}
    complete = [stem for stem in stems if all(stem + end in present for end in _FRAME_SUFFIXES)]
    return frozenset(stem + end for stem in complete for end in _FRAME_SUFFIXES)


def select_labels(
    labels: Sequence[str], visible: Sequence[int], not_positions: Iterable[str], modelled: Iterable[str]
) -> LabelSelection:
    """Select one column per marker.

    ``visible`` counts the frames in which each point is visible; ``not_positions`` are the names that the file lists as
    angles, powers, forces, moments or scalars, ``modelled`` those that it lists as modelled markers. Of several
    subjects in one file, and of several columns of one name, the one visible in the most frames is used.
    """
    remarks: list[Remark] = []
    listed = {without_prefix(name).lower() for name in not_positions}
    unlabelled = [i for i, label in enumerate(labels) if _UNLABELLED.match(without_prefix(label))]
    dropped = set(unlabelled)
    if unlabelled:
        remarks.append(Remark("unlabelled-points", f"{len(unlabelled)} points without a name were left out."))
    other = _other_subjects(labels, visible, dropped)
    if other:
        dropped |= other
        remarks.append(
            Remark(
                "several-subjects",
                f"The file has markers of several subjects; the most visible one is used, {len(other)} were left out.",
            )
        )
    column: dict[str, int] = {}
    doubled: set[str] = set()
    for i, label in enumerate(labels):
        name = without_prefix(label)
        if i in dropped or name.lower() in listed or _NOT_A_POSITION.search(name):
            continue
        if name in column:
            doubled.add(name)
            if visible[i] <= visible[column[name]]:
                continue
        column[name] = i
    if doubled:
        names = ", ".join(sorted(doubled))
        remarks.append(Remark("duplicate-labels", f"These labels occur twice; the more visible is used: {names}."))
    computed = {without_prefix(name) for name in modelled} | model_frames(column)
    if {"LHDF0", "RHDF0"} & set(column):
        computed |= {name for name in column if _OXFORD_FOOT.match(name)}
    outputs = frozenset(name for name in column if name in computed or _COMPUTED.match(name))
    return LabelSelection(column, outputs, tuple(remarks))


def _other_subjects(labels: Sequence[str], visible: Sequence[int], dropped: set[int]) -> set[int]:
    """Columns of all prefixes except the most visible one, if they share a marker name with it."""
    columns: dict[str, list[int]] = defaultdict(list)
    names: dict[str, set[str]] = defaultdict(set)
    for i, label in enumerate(labels):
        if ":" in label and i not in dropped:
            prefix = label.rsplit(":", 1)[0]
            columns[prefix].append(i)
            names[prefix].add(without_prefix(label))
    if len(columns) < 2:
        return set()
    seen = {prefix: sum(visible[i] for i in indices) for prefix, indices in columns.items()}
    best = max(seen, key=lambda prefix: seen[prefix])
    return {i for prefix, indices in columns.items() if prefix != best and names[prefix] & names[best] for i in indices}
