"""Check the style of README, CHANGELOG, CONTRIBUTING and docs; CONTRIBUTING has the rules.

Tables, headings and code are not checked. Exit code 1: a sentence breaks a rule.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORDS_MAX = 35
NUMBERS_MAX = 6
"""Outside brackets; the numbers of towns do not count."""

UNCHECKED = re.compile(r"^```.*?^```|<!--.*?-->|^\s*\|[^\n]*|^#[^\n]*", re.DOTALL | re.MULTILINE)
ITEM = r"^[ ]*(?:[*-]|\d+\.)[ ]"
BLOCK = re.compile(rf"(?:{ITEM})?\S.*?(?=\n\s*\n|\n{ITEM[1:]}|\Z)", re.DOTALL | re.MULTILINE)
SENTENCE = re.compile(r"\S.*?(?:[.!?](?=[\W_]*(?:\s+[\W_]*[A-Z0-9`]|$))|$)", re.DOTALL)
SUBJECT = re.compile(
    r"(?:^|[;:] |, (?:and|but|so) )(?:what|who|all that)\b|\b(?:whoever|whatever|nobody)\b", re.IGNORECASE
)
SPEECH = re.compile(r"\b(?:tell|tells|told|telling|say|says|said|saying|speaks?)\b", re.IGNORECASE)
TOWNS = re.compile(r"\bTowns? ?\d\d(?:(?:, | and )(?:Town)?\d\d)*")
NUMBER = re.compile(r"(?<![\w.])\d[\d.,]*(?: \d{3}\b)*")


def sentences(page: str) -> Iterator[tuple[int, str]]:
    """Line and text of every sentence of a Markdown page; code in backquotes becomes one word."""
    page = UNCHECKED.sub(lambda found: "\n" * found[0].count("\n"), page)
    page = re.sub(r"`[^`]*`", lambda found: "`code`" + "\n" * found[0].count("\n"), page)
    page = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", page)
    for block in BLOCK.finditer(page):
        text = re.sub(ITEM, "", block[0])
        start = block.end() - len(text)
        for found in SENTENCE.finditer(text):
            line = page.count("\n", 0, start + found.start()) + 1
            yield line, re.sub(r"[*_`]", "", " ".join(found[0].split()))


def faults(page: str) -> Iterator[tuple[int, str, str]]:
    """Line, broken rule and text of every sentence that breaks one."""
    for line, text in sentences(page):
        plain = TOWNS.sub("towns", re.sub(r"\([^()]*\)", "", text))
        checks = {
            "subject": SUBJECT.search(text) and not text.endswith("?"),
            "verb of speech": SPEECH.search(text),
            f"more than {WORDS_MAX} words": len(text.split()) > WORDS_MAX,
            f"more than {NUMBERS_MAX} numbers": len(NUMBER.findall(plain)) > NUMBERS_MAX,
        }
        yield from ((line, rule, text) for rule, broken in checks.items() if broken)


def main() -> int:
    """Print every fault."""
    pages = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
    code = 0
    for page in pages + sorted((ROOT / "docs").rglob("*.md")):
        for line, rule, text in faults(page.read_text(encoding="utf-8")):
            sys.stdout.write(f"{page.relative_to(ROOT)}:{line}: {rule}: {text}\n")
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
