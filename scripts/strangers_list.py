"""The recordings of public repositories that the survey expects: ``strangers.tsv``, see scripts/strangers.

The list states for every recording its repository on GitHub, commit and path, the files of its forces and its static
trial, what is marked, whether marker sets or rules were made with its source, and the outcome of the last survey. The
recordings themselves are not part of the project.
"""

import csv
import dataclasses
import itertools
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final, Literal

LIST: Final = Path(__file__).with_name("strangers.tsv")
ESTIMATES: Final = ("fused", "geometry")
PROMISOR: Final = ["config", "remote.origin.promisor", "true"]
"""Git then fetches a file when it is shown."""
HOST: Final = "https://github.com"
OTHER_PERSON: Final = 1.3
"""Ratio of two masses that are next to one another in a folder above which they are of two people."""
SESSION_SHARE: Final = 0.015
"""How far a trial's mass may be from that of its session."""
RUNNING: Final = re.compile(r"(?<![a-z])(run|sprint|jog)", re.IGNORECASE)

FIRST_SIGHT: Final = """\
## First sight

Outcomes with the program as it was when these recordings were first met, before anything was changed for them. None was
a crash, and every result more than 50 mm from the geometry had the error remark. mkjung99, freemocap, chrisdembia and
LecolLeng have trials or marker sets of sources that were tuned before; CGA_Rehazenter_Toolbox is of a
laboratory with a source that was. BatchOpenSim, CusToM, opencap-overlay, opensim-task-space, Pose2Sim_Blender,
HernandezVincent/OpenSim and opensim-creator were met after the others; marker sets were then made for the first two,
and a header without a rate is read.

Met last, 111 recordings at one sight: flash-running, pfjrf-methods, blender-mvnx-io, bip_opensim_hungarian_usports,
ceinms_tutorial, msk_modelling_python, APO-Inverse-Model, ergonomics, pyc3dtools, GaitEventsAlgorithms, c3d2OpenSim,
auto-lowerlimb-models-paper, PhysioMoCap and AGED_gait-event-detection. The runs of pfjrf-methods are those of a
laboratory with a source that was tuned, flash-running holds files of another, GaitEventsAlgorithms may be of the
laboratory of CGA_Rehazenter_Toolbox. What was mended for them afterwards: two marker sets, trunk labels that a set of
the legs does not know, one unmarked ball of the foot, a foot in the air above a belt that was taken for one beside the
plates, lateral gains of runs; those four sources count as tuned. Contradicted and right: `walkNorm_NP1002a07.c3d` and
`maxSprint.c3d` with its static trial state 24.2 and 55.1 kg where the plates weigh 28.8 and 69.4; the models
`P3m6_R_automatic.osim` hold one leg.

Met after all these, 142 recordings of 19 sources at one sight: javrx/biomec, EmilianoRF, LautaroEmeriSuhr, mrds90,
alangramlich and MatiasMadrid (one teaching laboratory), Kneerav/biomechanics, nmsm-examples (of the laboratory of
nmsm-core), Automatic_3D-Trajectory_labeling, Gait_Event_check, OpenSimMatlabBasic, marianamourao-37, c3dr, vaila,
wangshubo90/pose2sim, opencap-to-nwb, opensim-scripts, micro-bundle-adjustment and static_repetability. The one `crash`
is a warning of an empty slice, which the survey counts as one.

32 of these results were wrong: walks of the teaching laboratory, whose files give the plates y up and the markers
z up, were estimated lying on their side, without force, 18 of them with the verdict good. The plates of such files are
turned now (`plate-axes-turned`). Of the 25 walks of javrx/biomec 21 are fused; the masses of each of five persons agree
within 1 % over their trials, with 68.1 to 68.4 kg for the one whose stated mass was looked up (68.5). The forces of the
other seven files were rewritten in the axes of the markers, but not the corners of their plates: each has a check that
fails, and four are contradicted. Of the 603 listed recordings of other sources with plates, the body stands along the
vertical of the plates in 477, and the axis of the body is not known in 126. Mended as well: three marker sets, the
prefix that Motive writes before labels. Nothing was made with the ten sources that count as held-out but the sentence
with which the static trials of static_repetability, 0.2 s each, are refused.

Met last, 31 recordings at one sight: OpenMA/openma-data (23 that are new; 63 others are copies of BTKData, so that it
counts as tuned, although nothing was made with the 23), and AldanaFer, Luciosv and Zertyens of the teaching laboratory.
None was a crash, and nothing was changed for them. Both walks of the teaching laboratory are contradicted, with 78 and
101 mm from the geometry: their plates are turned, but one horizontal channel is dead and the centre of pressure lies 8
to 10 cm from the feet. They weigh 92.9 and 92.8 kg, and the walks of the same person in javrx/biomec 92.9 kg. Refused
are throws whose markers end at the pelvis, static trials with a knee alignment device, an upper body, and a sprint
start (`SprintMotion.c3d`) whose French names no set knows. A set for it was tried and not shipped: between the left and
the right ASIS there are 156 mm and from them to the sacrum 216, the regression scales the pelvis by the former, and the
hips come 7 cm too far forward; `leg_length_change` contradicts the result.

Met last, 9 recordings of three sources that were looked for once more: etoshey/colabC3D (of the laboratory of
pyc3dtools; its fourth file is a copy of `walking2.c3d`), moco-cycling-standing and surenkum/c3d_to_xyz (a trial of the
Carnegie Mellon database, with files of which the set `cmu` was made: tuned). Nothing was changed for them. Refused are
one whose names (ASIS_L, KNEE_LAT_L, MAL_LAT_L) no set knows although it marks legs and trunk, two of an arm, and two
whose knees are marked in a static trial only. Of these a cyclist who stands on the pedals has the static trial beside
it: where `--static` states it, the clusters of both trials carry knees and ankles, and the result is geometry,
doubtful, because a thigh changes its length by 15 %.

Met last, 129 recordings of nine sources at one sight, with the code of the commit that finds overloaded plates:
mcgillmotionlab/openOFM (54, of the laboratory of biomechzoo), marker-augmentation (18), processC3D_GUI (13, of the
laboratory of OpenSimMatlabBasic), PredSim-workshop-bcn-2024 (12), femoral-anteversion-paper (11), ESMAC_2023 (10 of
two people), opensim-pythonwrap (5), AFOProject (3), and KLAB_Preprocessing_toolbox (3, with names of files of
AnyBody/ammr: tuned). None was a crash. Pelvis, legs and trunk are marked, with plates, in 18 recordings of the
held-out ones: 14 gave an estimate, and six of these were wrong with the verdict good. A treadmill is in those files
four times, as plates of its belts and of the feet, and the person of 50 kg weighed 205 (`fws_end01`; two more were
contradicted). Such plates are not used now (`plates-repeated`; 49.8 kg, as stated, in the C3D file, 51.3 and 51.4 in
its TRC and MOT files). `-nan(ind)` in MOT files was refused as broken and is missing force now. processC3D_GUI and
ESMAC_2023 therefore count as tuned. Refused with a reason that is right: 46 of the feet alone, 10 whose knees are
marked in a static trial of other labels, five TRC files whose columns are separated by blanks, a body with three of
four iliac spines. `augmented_lying_reference` is refused as `sides-swapped`; it was computed by a network from a
person who lies, and was not looked into.

Met last, 60 recordings of six sources at one sight, with the code of the commit that first names markers by a proposal:
AnyBody/anymocap (40, most of one hospital; without the copies of AnyBody/ammr's), knee-grand-challenge-4th (8 of two
people), motion-data-processing (4 files of one trial and its static trial, of the laboratory of opensim-matlab),
lasem-trail-running and moco-examples (5 and 1, of the laboratory of lasem-data-processing) and mocaplib_examples (2; 43
more are copies). None was a crash, and no result is more than 50 mm from the geometry without an error remark. Pelvis,
legs and trunk are marked, with plates, in 12: seven gave an estimate, four fused, with force and markers within 21 mm
of one another, and three from the geometry; two of the seven have names by a proposal, which are right. Contradicted
are a step down from a box and two processed copies of one walk, whose forces differ from what its motion needs; the
causes were not looked into. Refused with labels of no known set are a boxer (VSACR, LKNEE, LANKL) and a walk with LTLE
and LTLM for knee and ankle, although both are marked whole; 28 trials of the hospital whose knees are marked in static
trials of one frame alone, and six of the knee challenge whose static trial the repository lacks, are refused with that
reason or for their labels. Nothing was changed for them; `Sit2Stand.c3d`, named by a proposal and without plates, is
refused since proposals include the distances of the markers. With these, 60 of 76 held-out recordings in which a full
body and plates are marked gave an estimate at first sight; 53 of 64 did before. Of all that are listed as held-out, 46
of 59 do now.

Met last, 52 recordings of eight sources at one sight: vicon-mocap-examples (14; two more are copies),
nmsm-advanced-tutorials (11) and nmsm-tutorial (10, both of the laboratory of nmsm-core), PyCGM_New (8; five more are
copies), auto-marker-label (4), StairAssist_Exo (3), theia2opensim and soft-exosuit-design (1 each). None was a crash,
and no result is more than 50 mm from the geometry without an error remark. Pelvis, legs and trunk are marked, with
plates, in seven: three of the pipeline's tutorials are fused; three on stairs were refused with labels of no known
set, although each label is known; one who stands is contradicted, for the plate, never unloaded, has the pressure 4 cm
behind the ankles. Of three that mark the legs alone, one is contradicted: its pelvis is hidden in most frames.

Mended afterwards: a label that sets know may lie at an unusual place, as on stairs (the three are contradicted now,
for the plates carry 12 kg more, an exoskeleton, than the person is stated to weigh), two marker sets for anymocap,
whose boxer and walk with LTLE and LTLM are fused now, and the metatarsals of gait2354; anymocap,
motion-data-processing and StairAssist_Exo therefore count as tuned. In the two copies of a walk in
motion-data-processing the lateral force has the wrong sign: it pushes each foot outwards. The tables above are of the
state before.

opensim-pythonwrap counts as tuned since TRC files separated by blanks are read, which were its five.
"""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One recording; ``forces`` and ``static`` are paths at the same commit, or empty.

    ``forces`` may name several files, separated by semicolons: of several plates, or a body model and forces.

    ``marked``: ``body`` for pelvis, legs and trunk; ``legs`` for pelvis and legs; ``static`` where only a static trial
    that the repository lacks marks the knees; ``other`` for the rest. ``plates`` counts the plates with force.
    ``outcome`` is ``fused``, ``geometry``, ``contradicted``, or the code of an error; ``first`` the outcome with the
    program as it was when the recording was first met, empty where that was not recorded.
    """

    repository: str
    commit: str
    path: str
    forces: str
    static: str
    use: Literal["tuned", "held-out"]
    marked: Literal["body", "legs", "static", "other"]
    plates: int
    outcome: str
    first: str = ""

    @property
    def place(self) -> str:
        """The folder of its files below that into which the list is fetched."""
        return f"{self.repository.replace('/', '+')}/{self.commit[:12]}"

    @property
    def others(self) -> list[str]:
        """Paths of the files that are read together with the recording."""
        return [name for name in self.forces.split(";") if name]

    @property
    def key(self) -> tuple[str, str]:
        """Source and path of its row in the survey."""
        return self.repository, f"{self.commit[:12]}/{self.path}"

    @property
    def is_running(self) -> bool:
        """Whether its name calls it a run or a sprint, and not the static trial of one."""
        path = self.path.lower()
        return RUNNING.search(path) is not None and "static" not in path and "calib" not in path


def read_list(path: Path = LIST) -> list[Entry]:
    """The entries of a list."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        return [Entry(**{**row, "plates": int(row["plates"])}) for row in rows]  # type: ignore[arg-type]


def write_list(entries: Iterable[Entry], path: Path = LIST) -> None:
    """Write the entries in order, one a line."""
    names = [field.name for field in dataclasses.fields(Entry)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter="\t", quoting=csv.QUOTE_NONE, quotechar=None, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(sorted(dataclasses.astuple(entry) for entry in entries))


def outcome_of(row: dict[str, Any]) -> str:
    """The outcome of a row of the survey, as an entry states it."""
    if row["outcome"] != "estimate":
        return str(row["outcome"])
    if row["verdict"] == "contradicted":
        return "contradicted"
    return "geometry" if row["method"] == "geometry" else "fused"


def fetch(entries: Sequence[Entry], folder: Path, mirrors: Path | None, host: str = HOST) -> None:
    """Extract the files of the list below a folder, from clones of the repositories at ``host`` or from mirrors.

    A mirror is a Git directory named ``owner+name`` or ``owner+name/repo``. Files that it lacks are named on stderr.
    """
    for entry in entries:
        for name in (entry.path, *entry.others, entry.static):
            to = folder / entry.place / name
            if not name or to.exists():
                continue
            git_show = subprocess.run(
                ["git", "-C", _repository(entry, folder, mirrors, host), "show", f"{entry.commit}:{name}"],
                capture_output=True,
                check=False,
            )
            if git_show.returncode:
                sys.stderr.write(f"not fetched: {entry.repository} {entry.commit}:{name}\n")
                continue
            to.parent.mkdir(parents=True, exist_ok=True)
            to.write_bytes(git_show.stdout)


def _repository(entry: Entry, folder: Path, mirrors: Path | None, host: str) -> Path:
    """The Git directory of an entry's repository, with its commit."""
    name = entry.repository.replace("/", "+")
    if mirrors is not None:
        mirror = mirrors / name
        return mirror / "repo" if (mirror / "repo").exists() else mirror
    clone = folder / ".git-clones" / name
    if not clone.exists():
        address = f"{host}/{entry.repository}.git"
        clone.mkdir(parents=True)
        for command in (["init", "--quiet", "--bare"], ["remote", "add", "origin", address], PROMISOR):
            subprocess.run(["git", "-C", clone, *command], check=True)
    if subprocess.run(["git", "-C", clone, "cat-file", "-e", entry.commit], check=False).returncode:
        command = ["fetch", "--quiet", "--depth", "1", "--filter=blob:none", "origin", entry.commit]
        subprocess.run(["git", "-C", clone, *command], check=False)
    return clone


def differences(entries: Sequence[Entry], rows: Sequence[dict[str, Any]]) -> list[str]:
    """One sentence for each recording whose outcome is not that of the list."""
    outcomes = {(row["source"], row["path"]): outcome_of(row) for row in rows}
    sentences = []
    for entry in entries:
        outcome = outcomes.get(entry.key, "not surveyed")
        if outcome != entry.outcome:
            sentences.append(f"{entry.repository} {entry.path}: {outcome}, expected {entry.outcome}")
    return sentences


def renewed(entries: Sequence[Entry], rows: Sequence[dict[str, Any]]) -> list[Entry]:
    """The entries with the outcomes of a survey."""
    outcomes = {(row["source"], row["path"]): outcome_of(row) for row in rows}
    return [dataclasses.replace(entry, outcome=outcomes.get(entry.key, entry.outcome)) for entry in entries]


def sessions_of(rows: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Rows of two trials or more of one person: of one folder, the same plates and rates, and masses that are alike.

    Trials with equal masses are one trial, published twice.
    """
    groups: dict[tuple[str, str, str], dict[float, dict[str, Any]]] = {}
    for row in rows:
        if row.get("weighed_kg"):
            folder = str(row["path"]).rpartition("/")[0]
            group = groups.setdefault((row["source"], folder, row["equipment"]), {})
            group.setdefault(round(row["weighed_kg"][0], 3), row)
    sessions = []
    for group in groups.values():
        masses = sorted(group)
        ends = [i for i, (a, b) in enumerate(itertools.pairwise(masses), 1) if b > OTHER_PERSON * a]
        for first, last in itertools.pairwise([0, *ends, len(masses)]):
            if last - first > 1:
                sessions.append([group[mass] for mass in masses[first:last]])
    return sessions
