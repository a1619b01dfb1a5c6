"""Check the style of pages, tutorials, and docstrings of scripts for readers; CONTRIBUTING has the rules.

In tables, only refused phrases count; code is not checked. Exit code 1: a sentence or title breaks a rule.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SCRIPTS = ("examples", "benchmarks", "docs")
"""Folders whose docstrings and tutorials are checked besides the pages."""
PACKAGES: tuple[str, ...] = ("carlaloc_env", "recorder")
"""Folders whose names in code are checked."""
WORDS_MAX = 35
NUMBERS_MAX = 6
"""Outside brackets; the numbers of towns do not count."""

CODE = re.compile(r"^```.*?^```|<!--.*?-->", re.DOTALL | re.MULTILINE)
UNCHECKED = re.compile(CODE.pattern + r"|^\s*\|[^\n]*|^#[^\n]*", re.DOTALL | re.MULTILINE)
ITEM = r"^[ ]*(?:[*-]|\d+\.)[ ]"
BLOCK = re.compile(rf"(?:{ITEM})?\S.*?(?=\n\s*\n|\n{ITEM[1:]}|\Z)", re.DOTALL | re.MULTILINE)
SENTENCE = re.compile(r"\S.*?(?:[.!?](?=[\W_]*(?:\s+[\W_]*[A-Z0-9`]|$))|$)", re.DOTALL)
SUBJECT = re.compile(
    r"(?:^|[;:] |, (?:and|but|so) )(?:what|who|all that)\b|\b(?:whoever|whatever|nobody)\b", re.IGNORECASE
)
SPEECH = re.compile(r"\b(?:tell|tells|told|telling|say|says|said|saying|speaks?)\b", re.IGNORECASE)
SPEECH_NAME = re.compile(r"(?:.*_)?(?:tells?|told|telling|says?|said)(?:_.*)?")
COUNT = r"(?:one|two|three|four|five|six|seven|eight|nine|ten|half|\d+)"
COUNTED = re.compile(
    rf"^{COUNT} (?:is|are|was|were|has|have|had|do|does|fails?|uses?|exceeds?|takes?|needs?|shows?)\b"
    rf"|\b(?:shows?|has|have|gives?|finds?) {COUNT} of {COUNT}(?=[.,;:]|$)",
    re.IGNORECASE,
)
"""A count in place of a noun: *Three test the renderer*, *It shows one of seven*."""
TITLE = re.compile(
    r"(?:what|why|where|when|who|which|is|are|does|do|how (?!to\b))\b(?!.*\?$)|the \w+ (?:at|as|on) "
    r"|(?:at the|on with|beside|going)\b|.*(?:, and\b|\bagain$|\bone's own\b|\.$)",
    re.IGNORECASE,
)
"""Titles that are clauses or hints, and no names of a subject; questions may be titles."""
DIALECT = {
    r"\b(?:goes|go|went|going) on\b(?! \w+ing\b)": "continue, resume",
    r"\bset(?:s|ting)? off\b|\bdrives? off\b": "start",
    r"\bcloses? up\b": "approach, follow",
    r"\b(?:need|needs) not\b": "can be harmless, does not have to",
    r"\bshort cuts?\b": "optimisation",
    r"\bplain way\b": "direct method",
    r"\b(?:straight|narrow|shorter|same|opposite|true) ways?\b|\b[%m] of (?:the )?way\b": "path",
    r"\bprocessor time\b|\bof the processor\b": "CPU time",
    r"\bof the clock\b|\bon the clock\b": "wall-clock time",
    r"\bseconds? driven\b|\bdriven seconds?\b": "simulated second",
    r"\bquiet (?:\w+ )?(?:machines?|cores?)\b": "idle",
    r"\b(?:beside other work|did other work|runs? beside)\b": "on a shared machine",
    r"\b(?:its|our|one's) own(?=[.,;:)]| \(|$)": "separate, or a noun after it",
    r"\bat the wheel\b": "drives",
    r"\b(?:row|line) an? (?:query|run|point|pose|town|sequence|frame|system)\b": "a row for each",
    r"\b(?:be|was|were|is|are) had\b": "installed, available",
    r"\bof (?:then|that time|yesterday)\b": "the version or date",
    r"\btime stands still\b": "one instant",
    r"\b(?:costs?|gains?|loses?|lost) (?:[\w-]+ )?×": "increases the error by",
    r"\bby as much\b": "by this factor",
    r"\b(?:to|with) no one\b": "the noun",
    r"\b(?:figures?|tables?|rules?|limits?|names?|numbers?|hash(?:es)?|units) stands?\b": "is in, is given",
    r"\b(?:a|the) bar for\b": "a limit, a target",
}
"""Refused phrases, and what to write."""
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


def titles(page: str) -> Iterator[tuple[int, str]]:
    """Line and text of every title of a Markdown page."""
    page = CODE.sub(lambda found: "\n" * found[0].count("\n"), page)
    for found in re.finditer(r"^#+ (.+)$", page, re.MULTILINE):
        yield page.count("\n", 0, found.start()) + 1, found[1]


def rows(page: str) -> Iterator[tuple[int, str]]:
    """Line and text of every row of a table; code in backquotes becomes one word."""
    page = CODE.sub(lambda found: "\n" * found[0].count("\n"), page)
    for found in re.finditer(r"^\s*\|[^\n]*", page, re.MULTILINE):
        yield page.count("\n", 0, found.end()) + 1, re.sub(r"`[^`]*`", "`code`", found[0].strip())


def dialect(text: str) -> Iterator[str]:
    """Rules for refused phrases of a text."""
    for pattern, better in DIALECT.items():
        if found := re.search(pattern, text, re.IGNORECASE):
            yield f"'{found[0]}' (better: {better})"


def faults(page: str) -> Iterator[tuple[int, str, str]]:
    """Line, broken rule and text of every title, row or sentence that breaks one."""
    yield from ((line, "title", text) for line, text in titles(page) if TITLE.match(text))
    for line, text in [*titles(page), *rows(page)]:
        yield from ((line, rule, text) for rule in dialect(text))
    for line, text in sentences(page):
        plain = TOWNS.sub("towns", re.sub(r"\([^()]*\)", "", text))
        checks = {
            "subject": SUBJECT.search(text) and not text.endswith("?"),
            "count as a subject": COUNTED.search(text),
            "verb of speech": SPEECH.search(text),
            f"more than {WORDS_MAX} words": len(text.split()) > WORDS_MAX,
            f"more than {NUMBERS_MAX} numbers": len(NUMBER.findall(plain)) > NUMBERS_MAX,
        }
        rules = [rule for rule, broken in checks.items() if broken]
        yield from ((line, rule, text) for rule in [*rules, *dialect(text)])


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """First line and text of every docstring of a module; lines of arguments become items."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                text = re.sub(r"(?m)^\w+:$", "", inspect.cleandoc(text))
                yield node.lineno, re.sub(r"(?m)^ +(?=\*{0,2}\w+: )", "* ", text)


def spoken_names(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every name that a module gives and that is a verb of speech, such as `_told`."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                pass
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                pass
            case _:
                continue
        if SPEECH_NAME.fullmatch(name):
            yield node.lineno, name


def texts() -> Iterator[tuple[Path, int, str]]:
    """File, first line and text of everything that is checked."""
    pages = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
    for page in pages + sorted((ROOT / "docs").rglob("*.md")):
        yield page, 1, page.read_text(encoding="utf-8")
    for path in sorted(path for folder in SCRIPTS for path in (ROOT / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        yield from ((path, line, text) for line, text in docstrings(source))
        for cell in re.finditer(r"^# %% \[markdown\]\n((?:#.*\n)+)", source, re.MULTILINE):
            yield path, source.count("\n", 0, cell.start(1)) + 1, re.sub(r"(?m)^# ?", "", cell[1])


def main() -> int:
    """Print every fault."""
    code = 0
    for path, first, whole in texts():
        for line, rule, text in faults(whole):
            sys.stdout.write(f"{path.relative_to(ROOT)}:{first + line - 1}: {rule}: {text}\n")
            code = 1
    for path in sorted(path for folder in PACKAGES for path in (ROOT / folder).rglob("*.py")):
        for line, name in spoken_names(path.read_text(encoding="utf-8")):
            sys.stdout.write(f"{path.relative_to(ROOT)}:{line}: verb of speech as a name: {name}\n")
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
