"""Names the formats that are not read, and the export of their program that is."""

from pathlib import PurePath
from typing import Final

from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.qualisys_tsv import is_qualisys_forces
from stridelab.recordings.opensim.body_model import is_body_model

_READ: Final = (
    "C3D files, TRC files, the TSV export of Qualisys, the CSV export of Vicon Nexus, MVNX files of Xsens, and zips of "
    "a TRC and a MOT or STO file, of an OpenSim model and its joint angles, or of the TSV files of one recording are "
    "read"
)
_TRIAL_OF_MODEL: Final = (
    "Put the model (.osim), the joint angles (_ik.mot) and the forces (_grf.mot) of one trial into one zip, or upload "
    "its C3D file."
)
_STORAGE: Final = (
    "an OpenSim file of joint angles or forces alone",
    "Put joint angles into one zip with their model (.osim), forces with the markers (.trc) or the model.",
)
_FORMATS: Final = {
    ".tdf": ("a BTS file", "Export a C3D file from SMART Tracker or SMART Analyzer."),
    ".mvn": ("an Xsens MVN recording", "Export an MVNX or C3D file from MVN."),
    ".b3d": ("an AddBiomechanics file of all trials of a subject", _TRIAL_OF_MODEL),
    ".osim": ("an OpenSim model", "Put it into one zip with the joint angles (.mot) and the forces of a trial."),
    ".mot": _STORAGE,
    ".sto": _STORAGE,
    ".trb": ("a binary Cortex file", "Export a TRC or C3D file from Cortex."),
    ".qtm": ("a Qualisys Track Manager file", "Export a C3D file, or TSV files of markers and forces, from it."),
    ".x1d": ("raw camera data of Vicon", "Reconstruct the trial in Nexus and export a C3D or CSV file."),
    ".x2d": ("raw camera data of Vicon", "Reconstruct the trial in Nexus and export a C3D or CSV file."),
    ".v": ("a Vicon trial of an older program", "Export a C3D file from Workstation or Nexus."),
    ".emt": ("a text file of BTS", "Export a C3D file from SMART Tracker or SMART Analyzer."),
    "motive": ("a CSV file of Motive (OptiTrack)", "Export a C3D or TRC file from Motive."),
    "utf-16": ("a text in UTF-16", "Save it as UTF-8."),
    ".bvh": ("a BVH file", "It holds joint angles and no markers: export a C3D or TRC file."),
}
"""What a file is by its suffix, and what to do instead."""
_BEGINNINGS: Final = {
    b"\x82\x4b\x60\x41\xd3\x11\x84\xca": ".tdf",
    b"HIERARCHY": ".bvh",
    b"BTS ASCII": ".emt",
    b"Format Version,": "motive",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
_SHOWN_BYTES: Final = 16


def unknown_format_error(head: bytes, name: str) -> UnreadableFile:
    """Error (``unknown-format``) that names the format of a file by its first bytes and its name, as far as known."""
    text = head.decode("utf-8-sig", errors="replace")
    seen = f"its first bytes are {head[:_SHOWN_BYTES].hex(' ')}"
    if head[:_SHOWN_BYTES].isascii() and text[:_SHOWN_BYTES].isprintable():
        seen = f"it begins with {text[:_SHOWN_BYTES]!r}"
    if is_qualisys_forces(text):
        what, advice = "the forces of a Qualisys export", "Put it and the TSV file of the markers into one zip."
    else:
        known = [suffix for start, suffix in _BEGINNINGS.items() if head.lstrip().startswith(start)]
        known += [".osim"] if is_body_model(text) else [".mot"] if "endheader" in text else []
        what, advice = _FORMATS.get((known or [PurePath(name).suffix.lower()])[0], ("of no known format", f"{_READ}."))
    message = f"{name} is {what} ({seen}). {advice}"
    return UnreadableFile("unknown-format", message, [Fault(name, seen)])
