"""Parts of the build beyond pages: the package as a wheel lays it out, the gallery, names, the search."""

import json
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from mkdocs.plugins import event_priority

ROOT = Path(__file__).resolve().parents[1]
_folders: list[Path] = []


@event_priority(100)  # before mkdocstrings reads its settings
def on_config(config: Any) -> Any:
    """Copy the modules, as a wheel lays them out, to where the API pages are read from."""
    folder = Path(tempfile.mkdtemp(prefix="pepper_kin_docs_"))
    _folders.append(folder)
    for source, place in (("pepper_kin", "."), ("planners", "planners"), ("urdf", "urdf")):
        for module in (ROOT / source).rglob("*.py"):
            copy = folder / "pepper_kin" / place / module.relative_to(ROOT / source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(module, copy)
    config.plugins["mkdocstrings"].config.handlers["python"]["paths"] = [str(folder)]
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Put every example's picture, with its name, where the home page has its gallery."""
    if page.file.src_uri != "index.md":
        return markdown
    examples = (ROOT / "docs" / "examples.md").read_text("utf-8")
    cards = [
        f"[{picture}{{ loading=lazy }} {title}](examples.md#{number}-{title.lower().replace(' ', '-')})"
        for number, title, picture in re.findall(
            r"^## (\d+) ([^\n]+)$.*?^(!\[[^\n]+\))$", examples, re.M | re.S
        )
    ]
    return markdown.replace(
        "<!-- gallery -->", "\n".join(['<div class="gallery" markdown>', "", *cards, "", "</div>"])
    )


def on_post_page(output: str, **_: Any) -> str:
    """Name the dialog of the search, which the theme leaves without a name."""
    return output.replace('role="dialog">', 'role="dialog" aria-label="Search">')


on_post_template = on_post_page  # of the page for addresses that are not there


BOOSTS = {
    "recipes/": 8.0,
    "api/": 0.1,
    "benchmarks": 0.1,
    "faults": 0.1,
    "verification": 0.1,
    "theory": 0.2,
    "validation": 0.2,
    "statuses": 0.2,
    "design": 0.2,
    "coming_from": 0.5,
    "notebooks": 0.5,
}
"""How much a page counts in the search, by the beginning of its address; 1 for guides and all others."""


@event_priority(-100)  # after the index is written
def on_post_build(config: Any) -> None:
    """Put recipes and guides before methods in the search, and what `search_tags` names before all."""
    path = Path(config.site_dir) / "search" / "search_index.json"
    index = json.loads(path.read_text("utf-8"))
    tags = dict(config.extra["search_tags"])
    for entry in index["docs"]:
        entry["boost"] = next((b for start, b in BOOSTS.items() if entry["location"].startswith(start)), 1.0)
        if entry["location"] in tags:
            entry["tags"] = tags.pop(entry["location"])
    if tags:
        raise ValueError(f"search_tags of mkdocs.yml names sections that there are not: {', '.join(tags)}")
    path.write_text(json.dumps(index, separators=(",", ":")), "utf-8")


def on_shutdown() -> None:
    """Remove the copies."""
    while _folders:
        shutil.rmtree(_folders.pop(), ignore_errors=True)
