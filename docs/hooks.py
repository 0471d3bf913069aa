"""What MkDocs does besides, for `make docs`: the front page, the API, the menu, the links.

README.md is the front page and CHANGELOG.md a page. The API's page is made from the docstrings that
are there. Pages that mkdocs.yml does not name get a place in the menu. Links to files outside docs/
lead into the working copy: site/ has the same depth as docs/.
"""

import ast
import posixpath
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES_OF_THE_ROOT = {"README.md": "index.md", "CHANGELOG.md": "changelog.md"}
API = "api.md"
EQUATIONS = "equations/"
GUIDES = "How-to guides"
PARAGRAPH = "\n\n"
VERBS = ("finloop.verbs", "finloop.project")  # whose members are shown one by one
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


# --- pages and menu


def on_config(config: Any) -> Any:
    """Complete the menu, and let headings have the anchors that GitHub gives them."""
    pages = (path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
    config["nav"] = complete_nav(config["nav"], sorted(pages), _title)
    config["mdx_configs"].setdefault("toc", {})["slugify"] = anchor
    return config


def anchor(heading: str, separator: str = "-") -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", separator)


def anchors(page: str) -> set[str]:
    """Return the anchors of all headings of a page."""
    return {anchor(heading) for heading in re.findall(r"^#+ (.+)$", page, re.MULTILINE)}


def complete_nav(nav: list[Any], pages: list[str], title: Callable[[str], str]) -> list[Any]:
    """Return the menu with every page: EQUATIONS below equations.md, others below the guides."""
    listed = set(nav_pages(nav))
    missing = [page for page in pages if page not in listed]
    sections = [{title(page): page} for page in missing if page.startswith(EQUATIONS)]
    guides = [{title(page): page} for page in missing if not page.startswith(EQUATIONS)]

    def extend(item: Any) -> Any:
        if not isinstance(item, dict):
            return item
        name, below = next(iter(item.items()))
        if not isinstance(below, list):
            return item
        more = guides if name == GUIDES else sections if "equations.md" in below else []
        return {name: [extend(one) for one in below] + more}

    return [extend(item) for item in nav]


def nav_pages(nav: Any) -> Iterator[str]:
    """Yield the pages of a menu."""
    if isinstance(nav, str):
        yield nav
    else:
        for item in nav.values() if isinstance(nav, dict) else nav:
            yield from nav_pages(item)


def _title(page: str) -> str:
    """Return the heading of a page, without marks."""
    first = (DOCS / page).read_text(encoding="utf-8").partition("\n")[0]
    return re.sub(r"[`*]", "", first.lstrip("# "))


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that lie outside docs/, and the page of the API."""
    from mkdocs.structure.files import File

    texts = {
        page: (ROOT / name).read_text(encoding="utf-8") for name, page in PAGES_OF_THE_ROOT.items()
    }
    for page, text in {**texts, API: api_page(ROOT / "finloop")}.items():
        files.append(File.generated(config, page, content=text))
    return files


def api_page(library: Path) -> str:
    """Return the page of the API as Markdown: verbs and project, then every package's modules."""
    parts = [
        "# API\n\nThe verbs go from a film to a video. `Project` opens what the pipeline has made."
        " The packages hold the functions of the stages.\n"
    ]
    parts += [f"\n## {name}\n\n::: {name}\n" for name in VERBS]
    parts += ["\n## Packages\n"]
    for package in sorted(path.parent for path in library.glob("*/__init__.py")):
        name = f"{library.name}.{package.name}"
        parts += [f"\n### {name}\n\n{_docstring(package / '__init__.py')}\n\n"]
        parts += [
            f"- `{path.stem}`: {_docstring(path).split(PARAGRAPH)[0]}\n"
            for path in sorted(package.glob("*.py"))
            if path.stem[0] != "_"
        ]
    return "".join(parts)


def _docstring(path: Path) -> str:
    """Return the docstring of a module, or nothing."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


# --- text


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Set the links of a page right."""
    source = page.file.src_uri
    names = {generated: name for name, generated in PAGES_OF_THE_ROOT.items()}
    return move_links(markdown, names.get(source, f"docs/{source}"))


def move_links(text: str, place: str) -> str:
    """Return the text of the file `place` with links as they are in the site."""
    folder = posixpath.dirname(place)
    home = posixpath.relpath(".", posixpath.relpath(folder, "docs") if folder else ".")

    def move(match: re.Match[str]) -> str:
        image, words, link = match.groups()
        path, mark, heading = link.partition("#")
        if not path or "://" in link or link.startswith("mailto:"):
            return match[0]
        target = posixpath.normpath(posixpath.join(folder, path))
        if target in PAGES_OF_THE_ROOT:
            target = f"docs/{PAGES_OF_THE_ROOT[target]}"
        if target.startswith("docs/"):
            inside = posixpath.normpath(posixpath.join(home, target.removeprefix("docs/")))
            return f"{image}[{words}]({inside}{mark}{heading})"
        # MkDocs refuses a link to what is no page; a browser follows it into the working copy.
        outside = posixpath.normpath(posixpath.join(home, "..", target))
        return f'<a href="{outside}{mark}{heading}">{words}</a>'

    return LINK.sub(move, text)
