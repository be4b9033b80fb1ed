"""All items in one go: what is stored and until when, what a failure leaves, and the two forms it is written in."""

from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from experiments.reproduction_page import (
    render_markdown,
    replace_sections,
)
from stridelab.conventions import Progress
from stridelab.errors import NotEstimable, NotFound
from stridelab.reproduction import result_cache
from stridelab.reproduction.chapter2 import fig_2_5
from stridelab.reproduction.claims import Claim, Reproduction, target
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.report.formatting import (
    basis_text,
    count_outcomes,
    table_cells,
    uncertainty_text,
)
from stridelab.reproduction.report.html import render_html
from stridelab.reproduction.result_cache import ResultCache
from stridelab.reproduction.runner import (
    PEOPLE,
    SEEDED,
    SHARING,
    Recipe,
    Section,
    collect_sections,
    group_sharing,
    recipes_of,
)

BOOK = Path(__file__).parents[2] / "docs" / "reproduction.md"
COMPUTED = Reproduction(
    claims=(
        Claim(
            "a", "one <claim>", 0.25, 0.0125, "m", "met", "With a <remark>.", "simulated", 5, "ipopt", (0.011, 0.5),
            where="figure 9.9", holds_to=0.5, threshold="thesis",
        ),
        Claim(
            "b", "another", "about the same", 1500.0, "N", "thesis_in_error", evidence="people", n=11,
            holds_from=1400.0, holds_to=1450.0,
        ),
    ),
    note="What it means & more.",
    tables={"printed": {"who": np.array(["me", "you"]), "error_m": np.array([0.002, np.nan])}, "other": {}},
    drawing='<svg xmlns="http://www.w3.org/2000/svg"><text>drawn</text></svg>\n',
)  # fmt: skip


class Counting:
    """A recipe's call that counts how often it is made, and fails as often as it has to."""

    def __init__(self, *failures: BaseException) -> None:
        self.calls = 0
        self.failures = list(failures)

    def __call__(self, tell: Progress) -> Reproduction:
        self.calls += 1
        tell(0.5, "half")
        if self.failures:
            raise self.failures.pop(0)
        return COMPUTED


def recipe(name: str, run: Counting, seeds: int = 1) -> Recipe:
    return Recipe(name, f"Title of {name}", "Draws.", range(seeds), ("printed",), fig_2_5.__name__, run)


def silent(_fraction: float, _message: str) -> None:
    pass


def test_what_is_stored_is_not_computed_again_and_comes_back_as_it_was(tmp_path: Path) -> None:
    run, reports = Counting(), []
    first, again = (
        list(collect_sections([recipe("x", run)], ResultCache(tmp_path), lambda f, m: reports.append((f, m))))
        for _ in range(2)
    )
    assert run.calls == 1
    assert reports == [(0.0, "x: starting"), (0.5, "x: half")]
    assert (first[0].result, again[0].failure) == (COMPUTED, "")
    back = again[0].result
    assert back is not None
    assert (back.claims, back.note, back.drawing, back.references) == (
        COMPUTED.claims, COMPUTED.note, COMPUTED.drawing, COMPUTED.references,
    )  # fmt: skip
    table = back.tables["printed"]
    assert table["who"].tolist() == ["me", "you"]
    np.testing.assert_array_equal(table["error_m"], COMPUTED.tables["printed"]["error_m"])
    assert list(back.tables) == ["printed"], "only what is printed is kept"
    list(collect_sections([recipe("x", run, seeds=2)], ResultCache(tmp_path), silent))
    list(collect_sections([recipe("x", run)], ResultCache(tmp_path), silent, recompute=True))
    assert run.calls == 3, "other draws, and what is requested anew, are computed"


def test_other_code_computes_anew_and_replaces_what_the_old_one_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Counting()
    for digest in ("one", "two"):
        monkeypatch.setattr("stridelab.reproduction.runner.digest_of", lambda _, digest=digest: digest)
        list(collect_sections([recipe("x", run)], ResultCache(tmp_path), silent))
    assert run.calls == 2
    assert [path.name for path in tmp_path.iterdir()] == ["x-1-two.json"]


def test_an_item_that_fails_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    known, unknown, fine = Counting(NotEstimable("code", "No sole is there.")), Counting(KeyError("hips")), Counting()
    wanted = [recipe("known", known), recipe("unknown", unknown), recipe("fine", fine)]
    sections = list(collect_sections(wanted, ResultCache(tmp_path), silent))
    assert [section.failure for section in sections] == ["No sole is there.", "KeyError: 'hips'", ""]
    assert [section.result is None for section in sections] == [True, True, False]
    assert [path.name[:5] for path in tmp_path.iterdir()] == ["fine-"], "nothing is stored of what failed"
    again = list(collect_sections(wanted, ResultCache(tmp_path), silent))
    assert all(section.result for section in again)
    assert (known.calls, unknown.calls, fine.calls) == (2, 2, 1)


def test_items_in_processes_are_those_of_one_process_in_their_order(tmp_path: Path) -> None:
    wanted, reports = recipes_of(["fig-2.5", "fig-2.2"], 1, None), []
    alone = list(collect_sections(wanted, ResultCache(tmp_path / "one"), silent))
    cache = ResultCache(tmp_path / "two")
    both = list(collect_sections(wanted, cache, lambda f, m: reports.append((f, m)), processes=2))
    assert [section.name for section in both] == ["fig-2.5", "fig-2.2"]
    for one, other in zip(alone, both, strict=True):
        assert one.result is not None
        assert other.result is not None
        assert one.result.claims == other.result.claims
        assert one.result.drawing == other.result.drawing
    assert [fraction for fraction, _ in reports] == [0.0, 0.5, 1.0]
    assert [path.name for path in sorted((tmp_path / "two").iterdir())] == sorted(
        path.name for path in (tmp_path / "one").iterdir()
    )


def test_items_that_share_draws_are_computed_in_one_process() -> None:
    names = ["fig-2.2", "fig-2.7", "fig-3.8", "errors", "fig-2.5"]
    assert group_sharing(names) == [[1, 3], [2], [0], [4]]
    assert group_sharing(["fig-2.5"]) == [[0]]
    assert {name for group in SHARING for name in group} <= set(ITEMS)


def test_a_claim_on_every_case_has_the_interval_of_the_share() -> None:
    claim = replace(COMPUTED.claims[0], interval=None, n=11, cases_inside=11)
    assert uncertainty_text(claim) == "11 of 11 in the range, 95 % from 0.715 to 1 of all"
    assert basis_text(claim).endswith(uncertainty_text(claim))
    certain = replace(claim, cases_inside=None, no_interval="deterministic", solver=None, n=1)
    assert basis_text(certain) == "simulated, deterministic, n = 1"
    assert basis_text(replace(certain, no_interval="machine_time")).endswith("; time of one machine, no interval")


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    done, stopped = Counting(), Counting(KeyboardInterrupt())
    wanted = [recipe("done", done), recipe("stopped", stopped)]
    with pytest.raises(KeyboardInterrupt):
        list(collect_sections(wanted, ResultCache(tmp_path), silent))
    assert all(section.result for section in collect_sections(wanted, ResultCache(tmp_path), silent))
    assert (done.calls, stopped.calls) == (1, 2)
    assert not list(tmp_path.glob(".part-*"))


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of three modules, of which the first leads to the second inside a function, and none to the third."""
    root = tmp_path / "stridelab"
    (root / "wing").mkdir(parents=True)
    (root / "item.py").write_text("def run():\n    from stridelab.wing import helper\n")
    (root / "wing" / "helper.py").write_text("import numpy\nimport stridelab.item\n")
    (root / "apart.py").write_text("x = 1\n")
    monkeypatch.setattr(result_cache, "PACKAGE", root)
    yield root
    _forget()


def _forget() -> None:
    for cached in (result_cache._module_source, result_cache._direct_imports, result_cache._data_digest):
        cached.cache_clear()


def test_a_digest_follows_the_imports_and_nothing_else(package: Path) -> None:
    def now() -> str:
        _forget()
        return result_cache.digest_of("stridelab.item")

    before = now()
    assert result_cache.transitive_imports("stridelab.item") == {"stridelab.item", "stridelab.wing.helper"}
    (package / "apart.py").write_text("x = 2\n")
    assert now() == before
    (package / "wing" / "helper.py").write_text("import numpy\n")
    assert now() != before


def test_a_figure_leads_to_the_formulas_behind_it() -> None:
    led = result_cache.transitive_imports(fig_2_5.__name__)
    assert "stridelab.estimation.complementary.transfer_functions" in led
    assert not any(name.startswith("stridelab.service") for name in led)
    assert "stridelab.reproduction.registry" not in led, "a new item would make all old ones stale"


class Outline(HTMLParser):
    """Identifiers, links to them, tags, and what would be fetched."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids, self.links, self.tags, self.fetched = [], [], [], []  # type: ignore[var-annotated]
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given["href"]] if tag == "a" else []
        self.fetched += [given[key] for key in ("src", "data") if key in given] + (["link"] if tag == "link" else [])


SECTIONS = (
    Section("x", "Title of x", "Draws once.", ("printed",), COMPUTED, command="stridelab reproduce x --seed 4"),
    Section("y", "Title of y", "", (), None, "No <sole> is there."),
)


def test_the_report_is_one_file_with_every_item_and_its_verdicts() -> None:
    text = render_html(SECTIONS, "Computed by hand.")
    outline = Outline(text)
    assert outline.ids == ["x", "y"]
    assert outline.links == ["#x", "#y"]
    assert outline.fetched == []
    assert "script" not in outline.tags
    assert outline.tags.count("svg") == 1
    for shown in (
        "one &lt;claim&gt;",
        "12.5 mm",
        "0.25 m",
        "about the same",
        "1500 N",
        "error mm",
        "drawn",
        "<td>2</td>",
    ):
        assert shown in text
    assert '<b class="aim_reached">0</b> our aim: reached' in text
    assert '<b class="beaten">0</b> better, <b class="met">1</b> met' in text
    assert "simulated, n = 5; solver ipopt; 95 % from 11 mm to 0.5 m" in text
    assert "<small>figure 9.9</small>" in text
    assert "≤ 0.5 m (thesis)" in text
    assert "Overturned by a 95 % interval outside ≤ 0.5 m." in text
    assert "Overturned by a number inside 1400 N to 1450 N." in text
    assert "<code>stridelab reproduce x --seed 4</code>" in text
    assert "1 item failed" in text
    assert "Not computed: No &lt;sole&gt; is there." in text


def test_the_page_of_the_book_has_the_same_numbers() -> None:
    text = render_markdown("# Head\n", SECTIONS)
    assert text.startswith("# Head\n\n## x: Title of x\n\nWhat it means & more. Draws once.\n")
    assert (
        "| one <claim> | figure 9.9 | 0.25 m | ≤ 0.5 m (thesis) | 12.5 mm | met | simulated, n = 5; solver ipopt; 95 % "
        "from 11 mm to 0.5 m |"
    ) in text
    assert (
        "| another | ours | about the same | 1400 N to 1450 N (our aim) | 1500 N | thesis in error | people, n = 11 |"
    ) in text
    assert "Computed again by `stridelab reproduce x --seed 4`." in text
    assert "- one <claim>: With a <remark>." in text
    assert "| who | error mm |" in text
    assert "| me | 2 |" in text
    assert "**Not computed**: No <sole> is there." in text


def test_an_aim_of_ours_is_counted_and_printed_apart_from_the_verdicts_on_the_thesis() -> None:
    aims = [target(key, ours, "1", at_most=1.0).says(key) for key, ours in (("reached", 0.5), ("missed", 2.0))]
    aims.append(target("open", 0.5, "1", at_most=1.0).says("open", interval=(0.2, 1.1)))
    both = replace(COMPUTED, claims=(*COMPUTED.claims, *aims))
    assert count_outcomes(both.claims) == {
        "not_met": 0, "thesis_in_error": 1, "undecided": 0, "met": 1, "beaten": 0, "aim_missed": 1, "aim_undecided": 1,
        "aim_reached": 1,
    }  # fmt: skip
    assert both.verdict == "thesis_in_error", "the missed aim weighs nothing beside a verdict on the thesis"
    assert replace(COMPUTED, claims=tuple(aims)).verdict == "not_met"
    text = render_markdown("", [replace(SECTIONS[0], result=both.with_basis("simulated", 1))])
    assert "| reached | ours | aim ≤ 1 | ≤ 1 (our aim) | 0.5 | our aim: reached |" in text
    assert "| missed | ours | aim ≤ 1 | ≤ 1 (our aim) | 2 | our aim: missed |" in text
    assert "| open | ours | aim ≤ 1 | ≤ 1 (our aim) | 0.5 | our aim: undecided |" in text


def test_what_is_better_than_claimed_is_not_printed_as_met() -> None:
    better = replace(COMPUTED, claims=(Claim("c", "faster", 10.0, 1.0, "s", "beaten", evidence="simulated", n=1,
                                           holds_to=10.0),))  # fmt: skip
    section = replace(SECTIONS[0], result=better)
    assert "| faster | ours | 10 s | ≤ 10 s (our aim) | 1 s | better | simulated, n = 1 |" in render_markdown(
        "", [section]
    )
    assert '<td class="beaten">better</td>' in render_html([section], "")


def test_a_section_of_the_page_is_replaced_alone() -> None:
    page = render_markdown("# Head\n", [SECTIONS[0], replace(SECTIONS[0], name="z")])
    other = replace(SECTIONS[0], name="z", result=replace(COMPUTED, note="Anew."))
    changed = replace_sections(page, [other])
    assert changed == render_markdown("# Head\n", [SECTIONS[0], other])
    added = replace(other, name="w")
    assert replace_sections(page, [added]) == render_markdown(
        "# Head\n", [SECTIONS[0], replace(SECTIONS[0], name="z"), added]
    )


def test_the_end_of_a_columns_name_is_its_unit() -> None:
    one = np.array([1.5])
    heads, rows = table_cells(
        {"rms_x_m": one, "lag_y_s": one, "speed_m_s": one, "jerk_m_s2": one, "draws": one.astype(int)}
    )
    assert heads == ["rms x mm", "lag y ms", "speed m/s", "jerk m/s²", "draws"]
    assert rows == [("1500", "1500", "1.5", "1.5", "1")]


def test_recordings_of_people_are_an_item_where_they_are(tmp_path: Path) -> None:
    assert [each.name for each in recipes_of(ITEMS, None, None)] == list(ITEMS)
    with_people = recipes_of(["fig-2.5", *PEOPLE], 3, tmp_path)
    assert [each.name for each in with_people] == ["fig-2.5", *PEOPLE]
    seeded = {each.name for each in with_people[1:] if not each.command.endswith("--recordings FOLDER")}
    assert seeded == set(SEEDED)
    (drawn,) = recipes_of(["height-people"], 3, tmp_path, 5)
    assert (drawn.seeds, drawn.sampling) == (range(5, 6), "One random sample, seed 5.")
    assert drawn.command == "stridelab reproduce height-people --recordings FOLDER --seed 5"
    with pytest.raises(NotFound, match="needs recordings"):
        recipes_of(["fig-3.6-people"], None, None)
    assert len(recipes_of(["fig-2.7"], None, None)[0].seeds) == ITEMS["fig-2.7"].default_seeds
    assert [each.seeds for each in recipes_of(["fig-2.7", "fig-4.5", "fig-2.5"], 3, None, 7)] == [
        range(7, 10), range(7, 8), range(1),
    ]  # fmt: skip
