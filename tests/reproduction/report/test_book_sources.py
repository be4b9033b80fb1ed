"""What the book was computed from: digests of code, recordings in their places, verdicts of other seeds."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import arrange_recordings
import make_reproduction
from arrange_recordings import arranged_files, digest_of_contents
from experiments.reproduction_page import codes_of, other_seeds_block, render_markdown
from stridelab.reproduction import runner
from stridelab.reproduction.chapter2 import fig_2_9_people, table_real_walks
from stridelab.reproduction.chapter3 import people_walks
from stridelab.reproduction.chapter4 import people_weights
from stridelab.reproduction.claims import Claim, Reproduction, above
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.result_cache import ResultCache
from stridelab.reproduction.runner import Section, collect_sections, recipes_of

CLONED = (
    "zmp-opensim/datasets/SchreiberMoissenet2019/data/2014001/dynamic/2014001_C4_05.c3d",
    "zmp-opensim/datasets/SchreiberMoissenet2019/data/2014001/dynamic/2014001_C5_01.c3d",
    "zmp-opensim/datasets/SchreiberMoissenet2019/data/2014001/static/2014001_ST.c3d",
    "zmp-opensim/datasets/HamnerDelp2013/data/subject01/expData/Run_4.trc",
    "zmp-opensim/datasets/HamnerDelp2013/data/subject01/expData/Run_4_grf.mot",
    "zmp-opensim/datasets/HamnerDelp2013/data/subject01/expData/Run_4_grf.xml",
    "zmp-opensim/datasets/HamnerDelp2013/data/subject01/model/static.trc",
    "zmp-opensim/datasets/HamnerDelp2013/data/subject01/ik/Run_4.mot",
    "biomechzoo/data/sample_study/raw c3d files/HC002D/Static/HC002D02.c3d",
    "biomechzoo/data/sample_study/raw c3d files/HC002D/Straight/HC002D06.c3d",
    "pyCGM/SampleData/Test_Files/Movement_trial.c3d",
    "pyCGM/SampleData/Test_Files/59993_Frame/59993_Frame_Dynamic.c3d",
)


@pytest.fixture
def clones(tmp_path: Path) -> Path:
    for name in CLONED:
        path = tmp_path / "clones" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return tmp_path / "clones"


def test_public_recordings_are_where_the_items_on_people_read_them(
    clones: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["arrange_recordings.py", str(clones), str(tmp_path)])
    arrange_recordings.main()
    gait = tmp_path / "gait"
    patterns = (
        *people_walks.SPEEDS.values(), *table_real_walks.GROUPS.values(), *people_weights.ADULTS,
        people_weights.CHILDREN, people_weights.STAIRS, fig_2_9_people.RUNS,
    )  # fmt: skip
    assert [len(list(gait.glob(pattern))) for pattern in patterns] == [1] * len(patterns)
    assert (gait / "rehazenter-adult-walking/2014001/2014001_ST.c3d").read_text() == CLONED[2]
    assert (gait / "biomechzoo-sample-study/HC002D/Static_HC002D02.c3d").read_text() == CLONED[8]
    assert (gait / "running/subject01/static.trc").is_file()
    assert "9 files, SHA-256" in capsys.readouterr().out, "neither settings of OpenSim nor other trials"


def test_a_set_without_its_clone_is_named(
    clones: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (clones / "biomechzoo").rename(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "argv", ["arrange_recordings.py", str(clones), str(tmp_path)])
    arrange_recordings.main()
    assert "biomechzoo-sample-study: missing, " in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["arrange_recordings.py", str(tmp_path / "none"), str(tmp_path / "other")])
    with pytest.raises(SystemExit, match="No recordings"):
        arrange_recordings.main()
    assert list(arranged_files(tmp_path / "none", "running")) == []


def test_the_digest_of_recordings_is_of_names_and_contents(clones: Path) -> None:
    files, digest = digest_of_contents(clones)
    assert files == len(CLONED)
    assert digest_of_contents(clones) == (files, digest)
    path = clones / CLONED[0]
    path.touch()
    assert digest_of_contents(clones)[1] == digest, "the time of a copy does not matter"
    path.write_text("other")
    assert digest_of_contents(clones)[1] != digest


def test_a_section_states_the_code_that_computed_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (section,) = collect_sections(recipes_of(["fig-2.5"], 1, None), ResultCache(tmp_path), lambda _f, _m: None)
    page = render_markdown("# Head", [section, Section("fig-2.2", "Another", "", (), section.result)])
    assert codes_of(page) == {"fig-2.5": section.code, "fig-2.2": ""}
    assert make_reproduction.stale_sections(page) == ["fig-2.2"]
    other = page.replace(section.code, "0" * len(section.code))
    assert make_reproduction.stale_sections(other) == ["fig-2.5", "fig-2.2"]
    monkeypatch.setattr(runner, "digest_of", lambda _: "one")
    assert recipes_of(["fig-2.5"], 1, None)[0].source_digest == "one"


def test_verdicts_of_other_seeds_are_listed_where_they_are_others() -> None:
    def section(first: int, *ours: float) -> Section:
        claims = tuple(
            Claim(f"{k}", f"claim {k}", 1.0, value, "1", above(0.5, "words").verdict(value))
            for k, value in enumerate(ours)
        )
        sampling = f"2 random draws, seeds {first} to {first + 1}."
        return Section("fig-2.6", "Title", sampling, (), Reproduction(claims, "", {}, ""))

    here = [section(0, 0.6, 0.7)]
    same = other_seeds_block(here, [section(10, 0.8, 0.9)])
    assert same == "2 of 2 verdicts are the same with other seeds (2 random draws, seeds 10 to 11; fig-2.6)."
    flipped = other_seeds_block(here, [section(10, 0.8, 0.4)])
    assert flipped.startswith("1 of 2 verdicts")
    assert "| fig-2.6 | claim 1 | 0.7 | 0.4 | met | not met |" in flipped
    aim = replace(here[0].result.claims[0], aim=True) if here[0].result else None
    assert aim is not None
    assert aim.outcome == "aim_reached"


def test_every_item_that_draws_takes_a_seed_and_no_other_does() -> None:
    for name, item in ITEMS.items():
        (recipe,) = recipes_of([name], 3, None, 1000)
        assert recipe.seeds[0] == (0 if item.draws == "nothing" else 1000), name
        assert ("--seed 1000" in recipe.command) == (item.draws != "nothing"), name
        assert ("--seeds " in recipe.command) == (item.draws == "many"), name
