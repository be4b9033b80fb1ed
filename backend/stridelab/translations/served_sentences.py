"""Sentences of the service that the pages translate; all others are shown in English, marked as such.

``%(name)s`` stands for a value. A person sees them: states of a job, verdicts on sensors, refusals and remarks.
"""

from typing import Final

from stridelab.translations.progress_sentences import PROGRESS
from stridelab.translations.walk_sentences import LEFT_OUT

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
    "The stored file is gone. Restore a backup, or upload the recording or compute the result again.",
    "%(name)s has no surface on which a foot can stand: at most 35 degrees steep, 10 cm long and wide.",
    "The recording lasts %(duration)s ms; at least %(least)s s are needed.",
    (
        "The body mass is neither stated nor in the file, and no force is measured for long enough to weigh the "
        "person. The method geometry needs no mass."
    ),
    (
        "The file of the terrain cannot be used. An image needs the edge of its cells and the height from black to "
        "white, in metres: state %(names)s."
    ),
)
"""Why a method is not possible for a recording, or a file cannot be read."""
REMARKS: Final = (
    "The feet stand still: the stated belt speeds are not used.",
    "The feet stand on a surface that moves at %(speed)s m/s: taken for a treadmill.",
    "These labels occur twice; the more visible is used: %(names)s.",
    "%(number)s points without a name were left out.",
    "Rebuilt from their rigid neighbours: %(names)s.",
    "Short gaps of %(number)s markers were interpolated (%(samples)s samples).",
    (
        "The labels belong to no known marker set. They were named from their likeness to known labels and from their "
        "places on the body: %(names)s. Check them on the body."
    ),
    "No mass is stated; the plates measure %(mass)s ± %(sd)s kg over %(trials)s trials of the session.",
    (
        "The sex of the subject is not stated: the mean of the female and the male body is used (costs about "
        "%(horizontal)s mm horizontally and %(vertical)s mm vertically)."
    ),
    "The plate %(name)s is never loaded and was left out.",
    "The centre of mass is that of the markers alone: %(reason)s",
    "Not every check of this recording passes. %(reasons)s",
    "The sensors contradict each other; do not use these numbers. %(reasons)s",
    "It is read with %(axis)s up, since most of it is level then; state another axis if it is wrong.",
    "It is read with %(axis)s up; another axis may point up, which the points do not tell.",
    "%(number)s more obstacles were left out; a terrain has at most %(most)s parts.",
)
"""Usual remarks on a recording or on a result."""
ON_PAGES: Final = (
    "Plate %(number)s read %(offset)s N while unloaded; this was subtracted.",
    "Plate %(number)s is never unloaded for long enough, so its zero could not be checked.",
    "Plate %(number)s: its channels pull the body down; their sign was reversed.",
    "Plate %(number)s: its ORIGIN has the opposite sign; the centre of pressure decided.",
    "Plate %(number)s: only %(share)s of its loaded centre of pressure lies inside its corners.",
    (
        "Plate %(number)s was left out: its loaded centre of pressure lies inside its corners for %(share)s of "
        "the time, whatever the unit of its moments. Its corners, its channels or its calibration are wrong."
    ),
    "Plate %(number)s reads %(zero)s N unloaded in other trials of the session; this is its zero.",
    "Plate %(which)s: the foot speeds up when it lands and slows down when it leaves; the plate may be turned.",
    "Plate %(number)s was left out: one of its channels has no scale.",
    "Plate %(number)s was left out: its channels hold impossible values.",
    (
        "The file says that the plates' moments are in %(stated)s; %(used)s is used, because then %(share)s of "
        "the loaded centre of pressure lies inside the plates' corners, as stated %(before)s."
    ),
    "Two feet stand on one plate at a time: the total force is right, the force per foot is not.",
    (
        "The plates carry less than the motion of the body needs at %(span_when)s: something beside them carries "
        "the rest (a part of a foot, a chair, a rail), or the stated mass is too large. These times are not used."
    ),
    "Plates %(list_repeated)s lie over plates %(list_used)s and repeat their force; they are not used.",
    (
        "Plate %(number)s is overloaded at %(span_when)s: one of its channels stays at its limit and does not follow "
        "the load. These times are not used."
    ),
    "The interval in which all force is measured holds %(part_steps)s; position offsets seen in it are uncertain.",
    "one whole step",
    "no whole step",
    (
        "The feet are not marked, so it is unknown when one of them stood beside the plates; the measured "
        "interval was estimated from the load on the plates and a symmetric walk."
    ),
    "The moments of %(name)s do not agree with its centres of pressure; its free moment is taken as zero.",
    (
        "Force and markers agree only if the plates are off by %(x)s N along x and %(y)s N along y, and "
        "%(declared)s N is declared: the stated band is too narrow. Zero the plates, or declare the bias."
    ),
    "%(number)s frames have no force and were cut off.",
    "%(name)s holds markers only, no ground forces.",
    (
        "%(name)s holds markers only, no ground forces. Where a MOT or STO file has them, put it and the TRC file"
        " into one zip."
    ),
    "An MVNX file holds no ground forces, only the motion of the body.",
    "The zip holds no ground forces. Where a MOT or STO file has them, put it into the zip.",
    "The %(part_what)s in the file (%(value)s) is no real value; it is not used.",
    *("height", "mass", "age"),
    "The file says its lengths are in %(stated)s, but the markers span a body in %(unit)s.",
    "The markers span no human body in any unit of length.",
    "The file has markers of several subjects; the most visible one is used, %(number)s were left out.",
    "The file has poses of body segments and no markers: the origins of the segments are used.",
    "The header of %(name)s states %(stated)s frames and %(number)s follow; those are used.",
    "Line 3 of %(name)s states %(stated)s frames and %(number)s follow; those are used.",
    "The header states %(stated)s frames, and the file ends after %(number)s, at the end of a frame; those are used.",
    (
        "Line 3 of %(name)s states %(stated)s frames and %(number)s follow; those are used. The file may have "
        "been cut off."
    ),
    "Line 3 of %(name)s states no Units. The lengths are read in %(unit)s, in which the markers span a body.",
    "Lines 2 and 3 of %(name)s state no DataRate; the times in column 2 give %(rate)s Hz.",
    "Lines of %(name)s end with up to %(number)s points that line 4 does not name; they were left out.",
    "The force file names contacts, not plates; the plates shown here bound their centres of pressure.",
    "Markers begin at %(markers)s s and forces at %(forces)s s; both are read from %(begin)s s on.",
    "The body stands along %(up)s of the file, which is used as the vertical axis, not %(hint)s.",
    (
        "The file states a subject of %(stated)s, and its markers show the legs of a person of about %(legs)s m: "
        "height, mass, sex and age in the file are those of somebody else, or in another unit, and are not used."
    ),
    "The times in %(name)s are not evenly spaced; its values were interpolated at %(rate)s Hz.",
    (
        "The marker set %(name)s, which named these markers, has been deleted: a new estimate uses the other "
        "sets. Name the markers on the page of the recording, with --marker or the field marker_map, or store a "
        "marker set for all recordings with these labels (--marker-set FILE, POST /marker-sets)."
    ),
    "%(number)s point without a name was left out.",
    "%(part_missing)s (costs about %(horizontal)s mm horizontally and %(vertical)s mm vertically).",
    "The head is not marked: it continues the trunk, its length scaled from the trunk",
    "The trunk is not marked: head, arms and trunk stand upright on the pelvis",
    "C7 or the jugular notch is not marked: the base of the neck is taken from the shoulders or C7",
    "The arms are not marked: they hang from the shoulders, fixed to the trunk",
    "The wrists are not marked: forearm and hand continue the upper arm",
    "The inner elbow is not marked: the elbow centre lies a stated distance inside the outer marker",
    "The inner knee is not marked: the knee centre lies a stated distance inside the outer marker",
    "The inner ankle is not marked: the ankle centre lies a stated distance inside the outer marker",
    "The ankles are not marked: they are placed from heel, forefoot and knee",
    "Heel or forefoot is not marked: the foot follows the shank or the toe",
    "The pelvis is not marked: it is placed from the hip centres, whose own errors come on top",
    "The knees are not marked in this trial: a static trial of the same person that marks them is needed.",
    "%(file)s is motionless and of the same session: it is used as the static trial.",
    "The subject moves in the static trial %(file)s: the body dimensions are less certain.",
    (
        "The static trial %(file)s shows a different body from this recording: %(first)s and %(second)s are "
        "%(there)s mm apart there and %(here)s mm here. It is of another subject, or markers were moved."
    ),
    (
        "Of the interval from %(start)s to %(end)s s, %(span_used)s are used: markers that the segment model "
        "needs are missing in the rest."
    ),
    "The belts move at %(speeds)s, as stated; the feet stand on a surface that moves at %(speed)s m/s.",
    "Treadmill: the belt speed of %(speed)s m/s is added to the motion.",
    "No mass is stated; %(part_mass)s follow from the plates: %(list_masses)s.",
    (
        "The mass of %(mass)s kg (%(part_source)s) is used. It differs from what the plates carried, but not by "
        "more than the errors explain: %(list_masses)s."
    ),
    "%(mass)s ± %(sd)s kg (%(part_source)s)",
    "%(mass)s ± %(sd)s kg",
    "stated",
    "in the file",
    "standing on the plates",
    "impulse of the vertical force",
    "mean force over whole steps",
    "standing in the static trial",
    "over all trials of the session",
    (
        "The plates contradict the mass of %(mass)s kg (%(part_source)s) by %(share)s: %(list_masses)s; "
        "%(part_cause)s. %(part_used)s are used, which explain the motion; with %(again)s kg the vertical "
        "acceleration from the force would be wrong by %(error)s m/s²."
    ),
    "either this mass or the plates' calibration is wrong",
    "either this mass or the plates' calibration is wrong, or something beside the plates carries a part of the weight",
    (
        "The plates weigh %(own)s ± %(sd)s kg in this trial and %(mass)s kg over %(trials)s trials of its "
        "session, %(difference)s N apart: the plates have another zero here, a part of a foot stands beside them,"
        " or something else carries weight."
    ),
    "The force was read %(late)s ms %(part_way)s, %(part_why)s",
    "Force and markers are taken as recorded, %(part_why)s",
    "later",
    "earlier",
    "as requested.",
    "as requested; the estimate is %(part_latency)s.",
    "as estimated %(part_where)s: %(part_latency)s.",
    "in this recording",
    "in its session",
    "%(latency)s ± %(sd)s ms over %(part_trials)s; this one alone: %(part_own)s",
    "%(latency)s ± %(sd)s ms over %(part_trials)s",
    "%(number)s trial",
    "%(number)s trials",
    "%(latency)s ± %(sd)s ms (%(along)s ms along the walk, %(vertical)s ms vertically)",
    "The latency of the force, %(part_latency)s, is not significant: the clocks are taken as recorded.",
    (
        "The force seems to be %(time)s ms %(part_late)s against the markers (%(part_latency)s); this is not "
        "corrected unless the latency is applied."
    ),
    "late",
    "early",
    (
        "This trial alone gives %(part_own)s, its session %(mean)s ± %(sd)s ms: more than %(limit)s standard "
        "deviations apart."
    ),
    (
        "The motions measured by the markers and by the plates do not resemble each other (correlation "
        "%(correlation)s), so their delay cannot be determined."
    ),
    "The delay between force and markers is uncertain by %(sd)s ms: there is too little motion.",
    (
        "The force varies by only %(share)s of the body weight, as in quiet stance: the delay between the clocks "
        "of force and markers cannot be determined."
    ),
    "The markers end together with the measured force: too few samples are left to compare their clocks.",
    "The %(part_best)s rejects this recording; the %(part_other)s filter is used instead: %(part_reason)s",
    "smoother",
    "complementary",
    (
        "The longest time on one foot in the window is %(longest)s s of a step of %(step)s s. At least one full "
        "single support is needed."
    ),
    (
        "At no time is all contact force on the plates, so force and geometry cannot be combined. Is every foot "
        "that touches the ground on an enabled plate?"
    ),
    "All contact force is measured for %(duration)s s at a time; at least %(least)s s are needed.",
    (
        "Only the %(part_marked)s foot is marked: strides and the margins at its strikes are those of this foot. "
        "When the %(part_hidden)s foot stands is unknown, so that nothing that needs it is measured."
    ),
    "left",
    "right",
    (
        "The labels %(labels)s name a walking aid or a rail. What it carries is not measured, and the base of "
        "support that the margins end at is that of the feet alone."
    ),
    (
        "The plates carry %(share)s of the body weight. A walking aid, a rail or another person may carry the "
        "rest, or the mass is wrong. The force is not used: the centre of mass is that of the markers alone, and "
        "the work of the legs is not measured."
    ),
    "Only one step could be fitted: %(part_scatter)s.",
    "its scatter is unknown",
    "the scatter is that of overlapping intervals",
    "No single support lies within the estimate with the foot marked.",
    "No step has a strike of each foot within the recording.",
    "No step within the estimate is a curtate cycloid of a walker.",
    "The force is measured throughout no stride; elsewhere the velocity is too uncertain for energies.",
    "No stride from strike to strike of one foot lies within the estimate.",
    "No whole stance of this foot is measured on plates of its own, or the body mass is not known.",
    "State the stature, by which the momentum is scaled.",
    "The plates do not carry the whole weight: the force of a leg on them is not all of it.",
    (
        "Whether a cane, a rail or another person carries a part of the weight is seen by plates under all feet "
        "only. Here no instant has them: the margins hold if the feet are the only support."
    ),
    "%(number)s steps; the regression needs at least %(least)s within the estimates.",
    "%(number)s strides in a row; the exponent needs at least %(least)s of one recording.",
    (
        "Columns with fewer than %(number)s people have no interval, and their order means nothing: a single "
        "recording is decided by the error of the force path."
    ),
    "%(number)s recordings have no subject; each counts as a separate person.",
    "%(number)s recordings have no subject; each counts as a separate subject.",
    (
        "%(number)s scores are left out because an estimator has none on the recording; columns compare the same "
        "recordings."
    ),
    "%(number)s recordings could not be scored: %(names)s.",
    "Not every check passes in %(number)s of %(total)s recordings: %(names)s.",
    "%(number)s of %(total)s steps have no usable wheel; they are in the table and in no mean.",
    "%(number)s recordings could not be fitted and are left out: %(names)s.",
    "The recordings of %(name)s state different values of %(field)s (%(values)s); the first is used.",
    "All subjects are also pooled, as requested: %(groups)s. Differences between groups count as trends.",
    "The groups are analysed separately: %(groups)s.",
    "The age is unknown, and subjects shorter than %(height)s m count as children: %(names)s.",
    "Group and age are unknown, so these subjects are neither children nor adults: %(names)s.",
    "The height is unknown, so it is not analysed for these subjects: %(names)s.",
    "The group %(group)s has %(part_subjects)s; a correlation needs at least %(least)s.",
    "1 subject",
    "%(number)s subjects",
    (
        "There are %(number)s whole steps (%(span_steps)s), but all contact force is measured only "
        "%(span_complete)s: no step is inside. With steps: all they are fitted from the markers."
    ),
    (
        "Feet stood on plate %(plate_number)s only. A step ends in double support, for which both feet must be on"
        " plates: of %(number)s whole steps (%(span_steps)s) none is measured (all force: %(span_complete)s)."
    ),
    (
        "Steps need a marker at the heel (or ankle) and one at the forefoot of both feet; this recording lacks "
        "them, so it is unknown when a foot swings."
    ),
    (
        "In %(duration)s s there is no whole step, which lasts from the lift-off of one foot to the next lift-off"
        " of the other."
    ),
    (
        "The centre of mass advances by only %(advance)s mm, so no rolling wheel can be fitted. Is the subject "
        "standing, or walking on a treadmill?"
    ),
    "Markers labelled right lie on the left: labels are swapped, or the axes of the file are mirrored.",
    "The pelvis cannot be located: mark ASIS and PSIS or a sacrum, or both hips, here or in a static trial.",
    "The knees are not marked in this trial; add a static trial of the same person that marks them.",
    "The segment model has no centre of mass for part of the window: markers are missing there.",
    "In no frame are all needed markers visible at once.",
    "The markers give a centre of mass for %(duration)s s at a time; at least %(least)s s are needed.",
)
"""Remarks and reasons that only the pages show, not their scripts, and the parts that they are composed of.

A place ``%(part_name)s`` stands for another of these sentences, ``%(list_name)s`` for several with commas between them,
and ``%(span_name)s`` for times with a "to" between them.
"""
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
    "force tilt", "normalised innovations", "force residual", "acceleration difference", "channel gain",
    "channel exchange", "horizontal bias", "vertical bias", "largest difference", "mass from motion",
    "mass from standing", "mass uncertainty", "flight acceleration", "pressure from feet", "pressure off plate",
    "force clipped", "body axis", "outside body", "leg length change", "body proportions", "proposed names",
    "model leg mass",
)  # fmt: skip
"""Checks of the sensors as verdicts list them, in place of ``%(checks)s``."""
SCRIPTED: Final = (*PROGRESS, *VERDICTS, *NOT_POSSIBLE, *REFUSALS, *OBSERVABILITY, *REMARKS)
"""Those that the scripts of the pages translate as well."""
SERVED: Final = (*SCRIPTED, *ON_PAGES, *LEFT_OUT)
"""All of them."""
