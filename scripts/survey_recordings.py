"""Estimate every recording below some folders and write a page of outcomes; see scripts/strangers.

Each folder is one source: the recordings of one laboratory or repository, fetched by the user of the survey. Every
recording is read and estimated with default options in a process of its own, with limits on time and memory. A TRC file
is zipped with the force file that belongs to it: one of the same name, or of the same name and a word such as ``_grf``.
A recording that is refused without a static trial is estimated with the one beside it, if there is exactly one.

The rows (one JSON object a line) tell for each recording its outcome: ``estimate``, or the code of the error. A survey
that was interrupted goes on where it stopped; delete the rows to start anew.
"""

import argparse
import collections
import hashlib
import json
import multiprocessing
import re
import resource
import statistics
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

TIMEOUT_S: Final = 90.0
MEMORY_BYTES: Final = 4 << 30
TOLERATED_MM: Final = 50.0
"""A result farther from the geometry must carry an error remark."""
NO_FORCE: Final = frozenset({"no-plates", "no-measured-window", "plates-unloaded", "window-too-short", "mass-unknown"})
"""Refusals of a fused estimate after which the geometry alone is tried."""
STATIC_NEEDED: Final = "knee-markers-missing"
FORCE_WORDS: Final = ("", "_grf", "_forces", "_force", "_grfs", "grf", "_ExtLoads", "_GRF")


def recordings_below(folder: Path) -> Iterator[Path]:
    """C3D and TRC files, each content once; a TRC file that has the name of a C3D file beside it is its twin."""
    seen: set[str] = set()
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in {".c3d", ".trc"} or not path.is_file():
            continue
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if digest not in seen:
            seen.add(digest)
            yield path


def force_file_of(trc: Path) -> Path | None:
    """The force file of a TRC file: beside it, or in another folder of its parent."""
    places = [trc.parent, *(path for path in trc.parent.parent.iterdir() if path.is_dir())]
    names = {f"{trc.stem}{word}{suffix}".lower() for word in FORCE_WORDS for suffix in (".mot", ".sto")}
    for place in places:
        for path in sorted(place.iterdir()):
            if path.name.lower() in names and b"force" in path.read_bytes()[:4000].lower():
                return path
    return None


def static_trial_of(path: Path) -> Path | None:
    """The only other file called ``static*`` beside a recording, else the only one in the folders of its parent."""
    for places in ([path.parent], [place for place in path.parent.parent.iterdir() if place.is_dir()]):
        found = [
            other
            for place in places
            for other in sorted(place.iterdir())
            if other.name.lower().startswith("static") and other.suffix.lower() == path.suffix.lower() and other != path
        ]
        if len(found) == 1:
            return found[0]
    return None


def uploaded(path: Path, folder: Path) -> Path:
    """What a user would upload: the file itself, or a zip of a TRC file and its forces."""
    forces = force_file_of(path) if path.suffix.lower() == ".trc" else None
    if forces is None:
        return path
    archive = folder / f"{path.stem}.zip"
    with zipfile.ZipFile(archive, "w") as made:
        made.write(path, path.name)
        made.write(forces, forces.name)
    return archive


def estimated(loaded: Any) -> tuple[Any, str | None]:
    """The estimate of a read recording; without usable force the geometry alone, and why the fusion was refused."""
    import stridelab as sl
    from stridelab.errors import StridelabError

    try:
        return sl.estimate_com(loaded), None
    except StridelabError as refusal:
        if refusal.code not in NO_FORCE:
            raise
        return sl.estimate_com(loaded, method="geometry"), refusal.code


def examine(path: Path, answer: Connection) -> None:
    """In a child: estimate one recording and send its row."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    import numpy as np

    import stridelab as sl
    from stridelab.errors import StridelabError

    warnings.simplefilter("error")
    row: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            loaded = sl.read(uploaded(path, Path(folder)))
            recording = loaded.recording
            row |= {"frames": recording.n_frames, "markers": len(recording.markers_m), "plates": len(recording.plates)}
            row["labels"] = hashlib.sha256("\n".join(sorted(map(str.lower, recording.markers_m))).encode()).hexdigest()[
                :8
            ]
            try:
                com, row["refused_fusion"] = estimated(loaded)
            except StridelabError as refusal:
                static = static_trial_of(path)
                if refusal.code != STATIC_NEEDED or static is None:
                    raise
                row["static"] = static.name
                com, row["refused_fusion"] = estimated(sl.read(loaded.path, static=static))
            geometry = com.result.prepared.geometric
            nearest = np.searchsorted(geometry.time_s, com.time_s - 1e-6).clip(max=len(geometry.time_s) - 1)
            difference_m = com.com_m - geometry.com_m[nearest]
            row |= {
                "outcome": "estimate",
                "method": com.summary.method,
                "window_s": list(com.summary.window_s),
                "mass_kg": com.summary.mass_kg,
                "difference_mm": round(float(np.nanmax(np.abs(difference_m)) * 1e3), 1),
                "verdict": com.summary.quality.verdict if com.summary.quality else None,
                "innovations": com.summary.diagnostics.get("normalised_innovations"),
                "remarks": [remark.code for remark in com.summary.warnings],
            }
        except StridelabError as refusal:
            row |= {"outcome": refusal.code, "message": str(refusal)[:300]}
        except BaseException as failure:  # noqa: BLE001 - a crash is an outcome to report
            row |= {"outcome": "crash", "message": f"{type(failure).__name__}: {failure}"[:300]}
    answer.send(row)


def row_of(path: Path, source: str, name: str) -> dict[str, Any]:
    """Examine one recording in a child that is killed when its time is over."""
    context = multiprocessing.get_context("forkserver")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=examine, args=(path, there), daemon=True)
    began_s = time.monotonic()
    child.start()
    there.close()
    try:
        row = here.recv() if here.poll(TIMEOUT_S) else {"outcome": "timeout"}
    except EOFError:
        row = {"outcome": "crash", "message": "the process ended without an answer"}
    child.kill()
    child.join()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return {"source": source, "path": name, "sha256": digest, "took_s": round(time.monotonic() - began_s, 2), **row}


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Outcomes by source, and the refusals with a sentence of one recording each."""
    lines = [
        "# Recordings of other laboratories",
        "",
        "Written by `scripts/strangers`: public recordings, read and estimated with default options. They are not",
        "part of the project. Evidence: measured on people; no truth is known for them, only whether a result",
        "contradicts itself.",
        "",
        "| source | recordings | fused | geometry only | contradicted | refused |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    sources = sorted({row["source"] for row in rows})
    for source in [*sources, None]:
        some = [row for row in rows if source in (None, row["source"])]
        done = [row for row in some if row["outcome"] == "estimate"]
        good = [row for row in done if row["verdict"] != "contradicted"]
        fused = sum(row["method"] != "geometry" for row in good)
        cells = (source or "all", len(some), fused, len(good) - fused, len(done) - len(good), len(some) - len(done))
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    wrong = [row for row in rows if row["outcome"] == "estimate" and row["difference_mm"] > TOLERATED_MM]
    silent = [row for row in wrong if row["verdict"] != "contradicted"]
    lines += [
        "",
        f"Results more than {TOLERATED_MM:.0f} mm from the geometry: {len(wrong)}; silently: {len(silent)}.",
        "",
        "| refused with | recordings | for example |",
        "| --- | --- | --- |",
    ]
    refused = collections.defaultdict(list)
    for row in rows:
        if row["outcome"] != "estimate":
            refused[row["outcome"]].append(row)
    for code, some in sorted(refused.items(), key=lambda item: -len(item[1])):
        message = re.sub(r"\s+", " ", some[0].get("message", "")).replace("|", "\\|")[:160]
        lines.append(f"| `{code}` | {len(some)} | {message} |")
    took_s = [row["took_s"] for row in rows]
    lines += ["", f"Time per recording: median {statistics.median(took_s):.1f} s, longest {max(took_s):.1f} s."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Survey the folders of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--rows", type=Path, default=Path("strangers.jsonl"), help="rows, one JSON object a line")
    parser.add_argument("--page", type=Path, help="write the page of outcomes here; default: print it")
    arguments = parser.parse_args()
    multiprocessing.set_start_method("forkserver")
    multiprocessing.set_forkserver_preload(["stridelab.library.recordings", "stridelab.pipelines.estimate_com"])
    rows = [json.loads(line) for line in arguments.rows.read_text().splitlines()] if arguments.rows.exists() else []
    known = {(row["source"], row["path"]) for row in rows}
    work = [
        (path, folder.name, str(path.relative_to(folder)))
        for folder in arguments.folders
        for path in recordings_below(folder)
        if (folder.name, str(path.relative_to(folder))) not in known
    ]
    with arguments.rows.open("a", encoding="utf-8") as out, ThreadPoolExecutor(2) as pool:
        for n, row in enumerate(pool.map(lambda item: row_of(*item), work), 1):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            sys.stderr.write(f"\r{n} of {len(work)} ")
    text = page(rows)
    if arguments.page:
        arguments.page.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
