"""The glossary, the pages and the names of the code agree, in both directions."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
ROWS = [row for row in re.findall(r"^\| ([^|]+) \|", GLOSSARY, re.MULTILINE) if row not in {"term", "---"}]
TERMS = {term.strip().lower() for row in ROWS for term in row.split(",")}
TEMPLATES = sorted((ROOT / "pipeline").rglob("*.html"))
PYTHON = [path for room in ("pipeline", "stages") for path in (ROOT / room).rglob("*.py")]
TEXT = " ".join(
    path.read_text(encoding="utf-8") for path in [*TEMPLATES, *PYTHON, *sorted((ROOT / "docs").glob("*.md"))]
)
ELSEWHERE = {
    "torsion angle",
    "worst over the turn",
    "mean",
    "standard deviation",
    "quantiles",
    "rated torque",
    "preloaded",
}
"""Terms that a page defines by numbers of its study, or that are those of any textbook."""
REPLACED = (
    "noise floors",
    "each fold took",
    "errs on the good side",
    "what comes again",
    "told apart by the data",
    "known as by",
    "stands for",
)
"""Words of our own in place of which the glossary has a term."""


def test_every_term_that_a_page_defines_is_in_the_glossary():
    page = (ROOT / "pipeline/report/sections/definitions.html").read_text(encoding="utf-8")
    titles = [re.sub("<[^>]+>", "", title) for title in re.findall(r"<dt[^>]*>(.*?)</dt>", page)]
    defined = {part.strip().lower() for title in titles if "{" not in title for part in title.split(",")}
    assert len(defined) > 8
    assert defined - TERMS <= ELSEWHERE


def test_every_name_in_the_glossary_exists_in_the_code():
    words = {word for path in PYTHON for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    names = {name for name in re.findall(r"`([^`\n]+)`", GLOSSARY) if re.fullmatch(r"[A-Za-z_]\w+", name)}
    assert names
    assert names <= words


@pytest.mark.parametrize(
    "term",
    ["surrogate", "effective sample size", "cross-validation fold", "share of the variance", "baseline", "yield"],
)
def test_a_standard_term_is_in_the_glossary_and_on_the_pages(term):
    assert term in TERMS
    assert len(re.findall(term, TEXT, re.IGNORECASE)) > 1  # beside the glossary's own row


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_no_page_has_a_word_of_our_own_for_a_term(path):
    text = path.read_text(encoding="utf-8").lower()
    assert [phrase for phrase in REPLACED if phrase in text] == []
