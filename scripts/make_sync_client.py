"""Write the synchronous client from the asynchronous one: ``client/synchronous.py`` from ``client/asynchronous.py``.

Usage: scripts/make_sync_client.py [--check]. With ``--check`` nothing is written, and the exit status is 1 where the
file on disk differs. The asynchronous client is the one to edit.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
CLIENT: Final = ROOT / "backend" / "stridelab" / "client"
SOURCE, TARGET = CLIENT / "asynchronous.py", CLIENT / "synchronous.py"
DOCSTRING: Final = '''"""The synchronous client, for scripts, notebooks and the command line.

Written by ``scripts/make_sync_client.py`` from the asynchronous one: edit that.
"""'''
RULES: Final = (
    (r'\A""".*?"""', DOCSTRING),
    (r"import asyncio\n", "import time\n"),
    (r"asyncio\.sleep", "time.sleep"),
    (r"AsyncIterator, Iterator", "Iterator"),
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\(await (self\.\w+\([^()]*\))\)", r"\1"),
    (r"\bawait ", ""),
    (r"\b(Abstract)?Async(Client|Iterator|ComStream|MarkerStream|ContextManager|BaseTransport)", r"\1\2"),
    (r"\b(open|watch)_async\b", r"\1_sync"),
    (r"\.a(close|read|iter_\w+)\(", r".\1("),
    (r"__a(enter|exit|iter)__", r"__\1__"),
)


def synchronous(text: str) -> str:
    """The source of the synchronous client, formatted."""
    for pattern, replacement in RULES:
        text = re.sub(pattern, replacement, text, flags=re.DOTALL)
    ruff = [sys.executable, "-m", "ruff"]
    for arguments in (
        ["check", "--quiet", "--fix", "--exit-zero", "--select", "F401,I,SIM117", "--unsafe-fixes"],
        ["format", "--quiet"],
    ):
        line = [*ruff, *arguments, "--stdin-filename", str(TARGET), "-"]
        text = subprocess.run(line, input=text, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    return text


def main() -> None:
    """Write the file, or compare it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    text = synchronous(SOURCE.read_text(encoding="utf-8"))
    if parser.parse_args().check:
        sys.exit(text != TARGET.read_text(encoding="utf-8"))
    TARGET.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
