"""Words: names and prose use the terms of robotics, by the table below."""

import ast
import io
import re
import subprocess
import tokenize
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

TERMS = {
    "Room": "workspace", "room": "workspace", "rooms": "workspaces", "Desk": "options", "Wishes": "options",
    "Setting": "problem", "Means": "context", "Evidence": "certificate inputs",
    "Find": "candidate", "Found": "candidate", "Descender": "local solver", "Descent": "local result",
    "precedence": "task priorities", "put_first": "task priorities", "hardened": "equalities",
    "loosen": "relax", "Fence": "linearized collision constraints",
    "urgency": "acceleration_scale", "gave_way": "relaxed", "Programme": "QuadraticProgram",
    "Oracle": "StateValidityChecker", "valid_prefix": "last valid step",
    "constrained_connect": "CBiRRT", "Manifold": "ConstraintManifold",
    "Wall": "barrier bound", "minimum_effort_swing": "minimum-torque trajectory",
    "Swing": "minimum-torque trajectory", "looks": "visual geometry",
    "lever": "motion bound or moment arm", "levers": "motion bounds", "joint_reaches": "motion bounds",
    "lever_arms": "motion bounds",
    "settle": "narrow phase, complementarity solve or hold_time", "settled": "decided, converged",
    "joint_law": "actuator model", "seen": "encoder reading or visited", "strange": "violation",
    "told": "inputs, reported", "given": "inputs", "quiet": "silent",
    "march": "integrate", "fly": "integrate",
    "slip": "wheel_slip, velocity", "soft": "compliance", "ray_march": "ray casting",
    "excess": "limit violation", "binding": "active limits", "make_safe": "enforce_limits",
    "piece": "segment, part, chunk", "pieces": "segments, parts, chunks",
    "instant": "time", "instants": "sample times", "Trier": "candidate evaluator",
    "floor_map": "base-placement map", "TOO_HEAVY": "TORQUE_LIMIT",
    "wish": "target, option", "wished": "requested",
}  # fmt: skip
"""Name that must not be -> the term of the field."""

EXCEPTIONS = {
    ("given", "tests"): "the decorator of hypothesis",
    ("binding", "pepper_kin/kernels"): "the module llvmlite.binding",
    ("binding", "tests/kernels"): "the module llvmlite.binding",
    ("binding", "tests/fuzz"): "the module llvmlite.binding",
    ("lever", "pepper_kin"): "Pinocchio's attribute Inertia.lever",
    ("lever", "tests"): "Pinocchio's attribute Inertia.lever",
    ("soft", "benchmarks"): "placo's word for a task's priority",
}
"""Name and folder -> why it may stand there."""

PHRASES = {
    r"\btold\b|\btells\b": "personification",
    r"\bwish(es|ed)?\b": "personification",
    r"\bs are wished\b|\blean(s)? less\b|\bwhereof\b|\blittle ado\b": "archaic or a riddle",
    r"(?<!here )\bis no (list|number|rotation|plan|path|file|whole|mesh|multiple|JSON|English)\b": "archaic",
    r"\bhas a say\b|\bhave a say\b": "personification",
    r"\bof (its|their|one's) own\b": "translated: separate, or nothing",
    r"\b([Tt]his|[Ee]ach|[Ee]very|[Ww]hich|[Oo]ther) rooms?\b": "a part of the library is a package",
    r"(?<!\band )(?<!\bthis )\bround (a|an|the|it|them|obstacles)\b": "British: around",
    r"\bcentre|\bcolour|\boptimis|\bneighbour|\bbehaviour|\bgrey\b|\bmetre|\bmodell(ed|ing)\b": "British",
}
"""Pattern that prose must not match -> why."""


PAGE_PHRASES = {
    **PHRASES,
    r"\brooms?\b(?! of 5 m)": "a part of the library is a package, memory an array",
    r"\banew\b": "archaic: again",
    r"\bgiv(e|es|ing) way\b|\bgave way\b": "personification: is relaxed",
    r"\bknows? (no|nothing|neither)\b": "personification: is independent of, ignores",
    r"\bbut for\b": "archaic: except",
    r"\b(solver|planner|code|check|checker|call)s? (ask|want|believe|hear|know)s?\b": "personification",
    r"\b[Ww]ho (wants|changes|has|needs|asks)\b": "translated",
    r"\bas far as that (pays|goes)\b|\bwhere that pays\b|\bis wished\b": "translated",
}
"""Pattern that pages and examples must not match -> why."""


@cache
def files(*suffixes: str) -> tuple[Path, ...]:
    """Return the files that git keeps, where this is a working copy, else all below the project's folders."""
    try:
        text = subprocess.run(
            ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        paths = [ROOT / line for line in text.splitlines()]
    except (OSError, subprocess.CalledProcessError):
        paths = [p for f in ("pepper_kin", "planners", "urdf", "tests", "docs", "examples", "benchmarks")
                 for p in (ROOT / f).rglob("*")]  # fmt: skip
    skipped = {ROOT / "tests" / "test_words.py", ROOT / "CHANGELOG.md"}
    return tuple(p for p in paths if p.suffix in suffixes and p not in skipped and p.is_file())


@cache
def names_in(path: Path) -> frozenset[str]:
    """Return all names of a Python file: tokens, and those inside of f-strings."""
    source = path.read_text("utf-8")
    names = {
        t.string for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type == tokenize.NAME
    }
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name):
            names.add(node.id)
        elif isinstance(node, ast.Attribute):
            names.add(node.attr)
    return frozenset(names)


@cache
def prose_of(path: Path) -> tuple[tuple[int, str], ...]:
    """Return number and text of all lines of comments and strings of a Python file."""
    tokens = tokenize.generate_tokens(io.StringIO(path.read_text("utf-8")).readline)
    return tuple(
        (token.start[0] + k, line.strip())
        for token in tokens
        if token.type in (tokenize.COMMENT, tokenize.STRING)
        for k, line in enumerate(token.string.split("\n"))
    )


def allowed(name: str, path: Path) -> bool:
    place = path.relative_to(ROOT).as_posix()
    return any(name == other and place.startswith(folder + "/") for other, folder in EXCEPTIONS)


@pytest.mark.parametrize("name", TERMS)
def test_no_name_is_one_of_the_old_words(name):
    part = re.compile(rf"{name}(?![a-z])") if name[0].isupper() and not name.isupper() else None

    def is_one(other):
        return other.strip("_") == name or (part is not None and part.search(other) is not None)

    found = [
        f"{path.relative_to(ROOT)}: {other}"
        for path in files(".py")
        for other in names_in(path)
        if is_one(other) and other not in KNOWN and not allowed(other, path)
    ]
    assert not found, f"{TERMS[name]!r} is the term: {found}"


KNOWN = {
    "ConstraintManifold", "CompiledManifold", "FileNotFoundError", "ModuleNotFoundError", "NoSolutionFound",
    "PackageNotFoundError",
}  # fmt: skip
"""Names that hold an old word and are terms of the field, or of Python."""


@pytest.mark.parametrize("name", TERMS)
def test_no_file_is_named_by_an_old_word(name):
    found = [p for p in files(".py", ".js", ".xacro", ".md", ".png") if name in re.split(r"[_\-/.]", p.stem)]
    found = [
        p for p in found if p.stem != "soft_costs" and not p.stem.endswith("_soft_costs")
    ]  # costs are soft
    assert not found


@pytest.mark.parametrize("name", [name for name in TERMS if "_" in name])
def test_no_page_or_macro_names_an_old_word(name):
    pattern = re.compile(rf"\b{name}\b")
    found = [
        p.relative_to(ROOT)
        for p in files(".md", ".js", ".xacro", ".html")
        if pattern.search(p.read_text("utf-8"))
    ]
    assert not found


@pytest.mark.parametrize("pattern", PHRASES)
def test_prose_of_the_package_is_plain(pattern):
    """Comments, docstrings and messages of the package; names and other texts are quoted in them."""
    matcher, found = re.compile(pattern), []
    for path in files(".py"):
        if path.relative_to(ROOT).parts[0] not in ("pepper_kin", "planners", "urdf"):
            continue
        found += [
            f"{path.relative_to(ROOT)}:{k}: {line}" for k, line in prose_of(path) if matcher.search(line)
        ]
    assert not found, f"{PHRASES[pattern]}:\n" + "\n".join(found)


@pytest.mark.parametrize("pattern", PAGE_PHRASES)
def test_prose_of_pages_and_examples_is_plain(pattern):
    """README, CONTRIBUTING, all pages of the documentation, and the examples."""
    matcher, found = re.compile(pattern), []
    pages = [path for path in files(".md") if path.name != "CHANGELOG.md"]
    examples = [path for path in files(".py") if path.relative_to(ROOT).parts[0] == "examples"]
    assert len(pages) > 60
    assert len(examples) >= 19
    for path in (*pages, *examples):
        lines = enumerate(path.read_text("utf-8").splitlines(), 1)
        found += [
            f"{path.relative_to(ROOT)}:{k}: {line.strip()}" for k, line in lines if matcher.search(line)
        ]
    assert not found, f"{PAGE_PHRASES[pattern]}:\n" + "\n".join(found)


PLAIN_FOLDERS = (
    "base_placement", "batch", "collision", "core", "dynamics", "files", "ik", "jobs", "kernels",
    "kinematics", "model", "motion", "naoqi", "servo", "symbolic", "trajectory", "twin", "viewer",
)  # fmt: skip
"""Packages whose prose is held to the patterns of pages; further ones are added as they meet them."""


@pytest.mark.parametrize("pattern", sorted(PAGE_PHRASES.keys() - PHRASES.keys()))
def test_prose_of_some_packages_is_as_plain_as_that_of_pages(pattern):
    matcher, found, count = re.compile(pattern), [], 0
    for path in files(".py"):
        parts = path.relative_to(ROOT).parts
        package = parts[0] == "pepper_kin" and (len(parts) == 2 or parts[1] in PLAIN_FOLDERS)
        if package or parts[0] in ("planners", "urdf"):
            count += 1
            found += [
                f"{path.relative_to(ROOT)}:{k}: {line}" for k, line in prose_of(path) if matcher.search(line)
            ]
    assert count > 300
    assert not found, f"{PAGE_PHRASES[pattern]}:\n" + "\n".join(found)


FIRST_WORDS = re.compile(
    r"(What|Where|Whether|Which|How|Who|Why|When|Between|From a|From an|From the|From start)\b"
)


@pytest.mark.parametrize("folder", ["pepper_kin", "planners", "urdf"])
def test_modules_begin_with_a_noun_phrase(folder):
    found = []
    for path in files(".py"):
        if path.relative_to(ROOT).parts[0] == folder:
            text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
            if FIRST_WORDS.match(text):
                found.append(f"{path.relative_to(ROOT)}: {text.splitlines()[0]}")
    assert not found, "\n".join(found)


def test_test_names_hold_no_old_word():
    words = {"told", "room", "levers", "looks", "wished", "excess", "instant", "oracle"}
    found = []
    for path in files(".py"):
        if path.relative_to(ROOT).parts[0] == "tests":
            for name in re.findall(r"def (test_\w+)", path.read_text("utf-8")):
                if words & set(name.split("_")):
                    found.append(f"{path.relative_to(ROOT)}: {name}")
    assert not found, "\n".join(found)
