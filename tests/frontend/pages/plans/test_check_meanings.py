"""Every check that a certificate can contain is explained on the page of a plan, and the book defines them."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx

from stridelab.wholebody import certificate
from stridelab_web.pages.terms.checks import CHAPTER, CHECK_MEANINGS
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
MAKE_CHECKS = frozenset({"Check", "at_most", "at_least", "torque_ratio", "smallest_distance"})
NAME = re.compile(r"[a-z]+(?:_[a-z]+)+")


def names_in_code() -> Iterator[str]:
    """First arguments of what makes a check in the package of the certificate."""
    for module in Path(certificate.__path__[0]).glob("*.py"):
        for call in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and call.args and isinstance(call.args[0], ast.Constant):
                called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
                if called in MAKE_CHECKS and NAME.fullmatch(str(call.args[0].value)):
                    yield str(call.args[0].value)


def test_every_check_has_a_meaning() -> None:
    named = set(names_in_code())
    assert len(named) > 15
    assert named - CHECK_MEANINGS.keys() == set()


def test_a_plan_explains_its_checks_and_leads_to_their_definition(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/plans/{fake.add_plan(replay=True).id}").text
    rows = re.findall(r'<tr data-check="(\w+)">(.*?)</tr>', page)
    known = [(name, row) for name, row in rows if name in CHECK_MEANINGS]
    assert known
    assert all(CHECK_MEANINGS[name] in row for name, row in known)
    assert f'href="{CHAPTER}"' in page
    address, anchor = CHAPTER.split("#")
    assert f'id="{anchor}"' in browse(address).text
