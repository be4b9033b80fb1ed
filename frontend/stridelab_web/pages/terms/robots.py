"""What the columns of a table of densities mean, on the page of a robot and of a job that learns them."""

from collections.abc import Mapping
from typing import Final

from stridelab_web.pages.terms.term import Term

_METHOD: Final = "/help/theory/reachability#method"
_SIZE: Final = "/help/theory/reachability#which-size"
_MEASURE: Final = "/help/theory/reachability#the-measure-of-a-robot-that-stands"
_SETS: Final = "/help/theory/reachability#visualisation"

DENSITY_TERMS: Final[Mapping[str, Term]] = {
    "effector": Term("foot or hand in contact, from which the centre of mass is seen", _METHOD),
    "frame": Term("axes of the density: those of the contact, or turned to the heading alone", _MEASURE),
    "size": Term("number of Gaussian bells in the mixture; below it, that of the thesis", _SIZE),
    "divergence": Term("how much the mixture differs from the sampled postures; 0 is no difference", _SIZE),
    "held_out": Term("how well the mixture predicts postures that it has not seen; higher is better", _SIZE),
    "kernel": Term("how far each sampled posture is smeared out", _METHOD),
    "postures": Term("sampled postures that were used; below it, the share that was rejected", _METHOD),
    "volume": Term("volume of the smallest region with this share of all postures", _SETS),
}
"""Columns of the table of densities."""

ROBOT_TERMS: Final[Mapping[str, Term]] = {
    "mass": Term("mass of all links together", "/help/how-to/add-a-robot#the-bundled-robots"),
    "com_height": Term(
        "height of the centre of mass in the standing posture", "/help/how-to/add-a-robot#the-bundled-robots"
    ),
    "joints": Term("joints that have a motor", "/help/how-to/add-a-robot#the-card-field-by-field"),
    "fingerprint": Term(
        "changes as soon as the robot's description does", "/help/theory/reachability#files-and-reproducibility"
    ),
}
"""Values under *Summary*."""
