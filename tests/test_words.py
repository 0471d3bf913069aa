"""Words: functions are verbs or name their result, a class name is there once, terms are few."""

import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
IRREGULAR = (
    "shown|drawn|known|seen|taken|given|made|told|said|kept|laid|held|sent|swum|worn|grown|thrown|"
    "found|built|left|lost|met|begun|broken|chosen|driven|hidden|written|sought|fed|led|lit|bent|"
    "swept|spun|hung|wound|woven|bound|brought|caught|taught|thought"
)
NO_PARTICIPLES = {"embed", "exceed", "feed", "need", "proceed", "seed", "speed"}
NO_NAMES = "of|at|now|some|one|way|own|every|before|after|between|here|there|again|most"
"""Names that say nothing."""


def names_nothing(name: str) -> bool:
    """Return whether a function's name is a participle or a pronoun alone."""
    word = name.strip("_")
    if re.fullmatch(f"{NO_NAMES}|{IRREGULAR}", word):
        return True
    return bool(re.fullmatch(r"[a-z]+ed", word)) and word not in NO_PARTICIPLES


@cache
def definitions(folder: str) -> list[tuple[str, str, str]]:
    """Return place, kind (`def` or `class`) and name of all that a folder's files define."""
    wanted = re.compile(r"^ *(?:async )?(def|class) (\w+)", re.MULTILINE)
    return [
        (str(path.relative_to(ROOT)), *found.groups())
        for path in sorted((ROOT / folder).rglob("*.py"))
        for found in wanted.finditer(path.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize("name", ["mapped", "_shown", "of", "way"])
def test_a_name_that_says_nothing_is_recognised(name):
    assert names_nothing(name) and not names_nothing("map_rows")
    assert not names_nothing("speed") and not names_nothing("tail_spread")


def test_no_function_is_named_by_a_participle_or_a_pronoun():
    """Tests themselves begin with `test_`; their helpers and fixtures are checked, too."""
    found = [
        f"{place} {name}"
        for folder in ("finloop", "stages", "benchmarks", "docs", "tests")
        for place, kind, name in definitions(folder)
        if kind == "def" and names_nothing(name)
    ]
    assert not found, "\n".join(found)


def test_no_class_name_is_there_twice():
    where = defaultdict(list)
    for place, kind, name in (*definitions("finloop"), *definitions("stages")):
        if kind == "class":
            where[name].append(place)
    twice = {name: places for name, places in where.items() if len(places) > 1}
    assert not twice


def test_the_glossary_has_few_terms_each_once():
    lines = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").split("\n")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line[:2] == "| "]
    terms = [row for row in rows if row[0] != "term"]
    assert 40 <= len(terms) <= 60 and len({row[0] for row in terms}) == len(terms)
    assert all(len(row) == 3 and all(row) for row in terms)


BANNED = {
    "whoever": "the one who, or a name",
    r"foret(?:ell|old)\w*": "predict",
    "told from": "distinguished from",
    "so far ahead": "within the horizon",
    "it is asked": "say who asks",
    "is as before": "does not change",
    r"no more(?! than)": "not any more",
    "swum": "swims, or the noun of what is meant",
    "waters": "world, or tank",
    r"dear(?:er|est)?": "costly",
    r"errands?": "task",
    "crew": "workers",
    r"employ(?:s|ed|er)?": "submit",
}
"""Words that a reader stumbles over, and what to write."""
TEXTS = {".py", ".md", ".yaml", ".html", ".js", ".j2"}


@cache
def texts() -> dict[str, str]:
    """Return every file that somebody reads, by its path."""
    folders = ("finloop", "stages", "benchmarks", "hydra_plugins", "examples", "conf", "docs")
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*"))]
    files = [path for path in files if path.suffix in TEXTS]
    files += [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "Makefile"]
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in files}


def test_nobody_stumbles_over_a_word():
    """In code, conf, docs, messages and pages; an identifier counts as well."""
    wanted = re.compile(rf"(?<![a-z])(?:{'|'.join(BANNED)})(?![a-z])")
    found = [
        f"{path}: …{text[max(0, hit.start() - 40) : hit.end() + 20]!r}…: write "
        + next(better for word, better in BANNED.items() if re.fullmatch(word, hit[0]))
        for path, text in texts().items()
        for hit in wanted.finditer(text.lower())
    ]
    assert not found, "\n".join(found)
