"""The site of the guides: every page is in the menu, links and anchors lead somewhere."""

from pathlib import Path

import pytest
import yaml

from docs.hooks import API, PAGES_OF_THE_ROOT, anchor, api_page, complete_nav, move_links, nav_pages

ROOT = Path(__file__).parents[1]
NAV = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
MADE = {API, "parameters.md", *PAGES_OF_THE_ROOT.values()}  # by `make docs`


def test_every_page_is_in_the_menu_once_and_every_entry_is_a_page():
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    listed = list(nav_pages(complete_nav(NAV, sorted(pages), str)))
    assert len(listed) == len(set(listed))
    assert set(listed) == pages | MADE


def test_a_page_that_is_not_named_gets_its_place():
    nav = [{"How-to guides": ["a.md"]}, {"Reference": [{"Equations": ["equations.md"]}]}]
    pages = ["a.md", "b.md", "equations.md", "equations/c.md"]
    assert complete_nav(nav, pages, str.upper) == [
        {"How-to guides": ["a.md", {"B.MD": "b.md"}]},
        {"Reference": [{"Equations": ["equations.md", {"EQUATIONS/C.MD": "equations/c.md"}]}]},
    ]


@pytest.mark.parametrize(
    "place, link, there",
    [
        ("README.md", "docs/paths.md#times", "[`a`](paths.md#times)"),
        ("README.md", "CHANGELOG.md", "[`a`](changelog.md)"),
        ("docs/results.md", "../README.md", "[`a`](index.md)"),
        ("docs/equations/loops.md", "../results.md", "[`a`](../results.md)"),
        ("docs/equations.md", "equations/loops.md", "[`a`](equations/loops.md)"),
        ("docs/paths.md", "#times", "[`a`](#times)"),
        ("docs/paths.md", "https://dvc.org", "[`a`](https://dvc.org)"),
        ("README.md", "CITATION.cff", '<a href="../CITATION.cff">`a`</a>'),
        ("docs/results.md", "../conf", '<a href="../conf">`a`</a>'),
        ("docs/equations/loops.md", "../../conf", '<a href="../../conf">`a`</a>'),
    ],
)
def test_a_link_stays_within_the_site_or_leads_into_the_working_copy(place, link, there):
    assert move_links(f"see [`a`]({link}).", place) == f"see {there}."


def test_anchors_are_those_of_github():
    assert anchor("7. Take it with you: `a`, b – c?") == "7-take-it-with-you-a-b--c"


def test_the_page_of_the_api_lists_every_package_and_its_modules(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "room/__init__.py").write_text('"""A room."""')
    (tmp_path / "room/part.py").write_text('"""A part.\n\nIt does more."""')
    assert api_page(tmp_path).endswith(".room\n\nA room.\n\n- `part`: A part.\n")
