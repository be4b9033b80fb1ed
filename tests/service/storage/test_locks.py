"""The keys of the advisory locks stand in one place and differ."""

import re
from pathlib import Path

from stridelab.service.storage import locks

SERVICE = Path(locks.__file__).parents[1]


def test_no_two_locks_share_a_key() -> None:
    keys = {name: value for name, value in vars(locks).items() if name.isupper()}
    assert len(keys) >= 7
    assert all(isinstance(key, int) and 0 <= key < 2**63 for key in keys.values())
    assert len(set(keys.values())) == len(keys)


def test_every_advisory_lock_takes_its_key_from_there() -> None:
    """Except that on a file, whose key is a hash of the file's place; a function of the database is given its key."""
    calls, given = [], []
    for path in sorted(SERVICE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for call in re.finditer(r"pg_(?:try_)?advisory_(?:xact_)?lock(?:_shared)?\((.{0,60})", text):
            calls.append(path.name)
            if argument := re.match(r"([a-z_]+)\);", call[1]):
                given.append(argument[1])
                continue
            assert re.match(r"locks\.[A-Z_]+\)|:key\)\"\), \{\"key\": locks\.|%s\)\", \(locks\.|func\.hash", call[1]), (
                f"{path.name} takes an advisory lock by a key of its own"
            )
    assert len(calls) >= 9
    (store,) = SERVICE.glob("jobs/store.py")
    for name in given:
        assert re.search(rf'"{name}": locks\.[A-Z_]+,', store.read_text(encoding="utf-8")), f"{name} has another key"
    assert given == ["admission_lock"]
