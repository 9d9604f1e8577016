"""Programs in Python 2: translation on import, with Python 2's built-in names and strings.

`lib2to3` (or `fissix`) translates the syntax.  This module adds what remains: integer division, text and
bytes as one kind of string, as far as programs for robots use that, and the old names of the standard
library's modules.
"""

from __future__ import annotations

import ast
import builtins
import codecs
import copy
import functools
import importlib
import math
import re
import sys
import types
import warnings
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.reading import read_bytes

OLD_MODULES = {
    "BaseHTTPServer": ("http.server",),
    "ConfigParser": ("configparser",),
    "Cookie": ("http.cookies",),
    "HTMLParser": ("html.parser",),
    "Image": ("PIL.Image",),
    "Queue": ("queue",),
    "SimpleHTTPServer": ("http.server",),
    "SocketServer": ("socketserver",),
    "StringIO": ("io",),
    "Tkinter": ("tkinter",),
    "__builtin__": ("builtins",),
    "cPickle": ("pickle",),
    "cStringIO": ("io",),
    "commands": ("subprocess",),
    "cookielib": ("http.cookiejar",),
    "copy_reg": ("copyreg",),
    "httplib": ("http.client",),
    "mutex": ("pepper_kin.naoqi.shims.mutex",),
    "thread": ("_thread",),
    "tkFileDialog": ("tkinter.filedialog",),
    "tkMessageBox": ("tkinter.messagebox",),
    "tkFont": ("tkinter.font",),
    "ttk": ("tkinter.ttk",),
    "urllib2": ("urllib.parse", "urllib.error", "urllib.request"),
    "urlparse": ("urllib.parse",),
    "xmlrpclib": ("xmlrpc.client",),
}
"""Old name of a module -> modules with its contents."""

_OLD_NAMES = {"xrange", "raw_input", "unicode", "basestring", "long", "unichr", "execfile", "reduce", "cmp"}
_OLD_METHODS = {"has_key", "iteritems", "itervalues", "iterkeys"}
_OF_STRINGS = {"decode", "encode", "frombuffer", "frombytes", "fromstring", "tostring"}
_RESERVED = re.compile(r"\.async\b")
_ASYNC_ARGUMENT = re.compile(r"\basync\s*=")
_TRUE_DIVISION = re.compile(r"^\s*from\s+__future__\s+import\s[^\n]*\bdivision\b", re.MULTILINE)


def program(path: Path) -> tuple[types.CodeType, bool]:
    """Return the code of a script or a module, and whether it is in Python 2.

    A text that Python 3 can read counts as Python 2 if it imports modules or uses names that only
    Python 2 has, including `naoqi`.

    Raises:
        FileFormatError: for a text in neither language; the error names the line.
    """
    text = read_bytes(path).decode("utf-8", errors="replace")
    tree, old = _tree(path, text, None)
    return _compiled(path, tree), old


def old_program(path: Path, text: str, line: int) -> types.CodeType:
    """Return the code of a Python 2 program that starts at a line of a file."""
    try:
        tree = copy.deepcopy(_old_tree(text))
    except FileFormatError as error:
        raise FileFormatError(path, error.reason, line + (error.line or 1) - 1) from error
    return _compiled(path, ast.increment_lineno(tree, line - 1))


def _compiled(path: Path, tree: ast.Module) -> types.CodeType:
    try:
        return compile(tree, str(path), "exec")
    except SyntaxError as error:
        raise FileFormatError(path, f"cannot be compiled by Python: {error.msg}", error.lineno) from error


@functools.lru_cache(256)
def _old_tree(text: str) -> ast.Module:
    return _tree(Path("text"), text, True)[0]


def _tree(path: Path, text: str, old: bool | None) -> tuple[ast.Module, bool]:
    """Parse a text as Python 3 or, if `old` or needed, as Python 2; return the tree and whether it is old."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    source = _RESERVED.sub(".async_", _ASYNC_ARGUMENT.sub("_async=", text))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source, str(path))
            if not old and not _is_old(tree):
                return ast.fix_missing_locations(_Interruptible().visit(tree)), False
        first = None
    except SyntaxError as error:
        first = error
    except (ValueError, RecursionError, MemoryError) as error:
        raise FileFormatError(path, f"cannot be compiled by Python: {error}") from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            tree = ast.parse(_translated(path, source, first), str(path))
        except FileFormatError:
            if first is not None:
                raise  # otherwise it is Python 3 with an old name or two
        tree = _OldMeaning(_TRUE_DIVISION.search(source) is None).visit(tree)
        return ast.fix_missing_locations(tree), True


def _is_old(tree: ast.AST) -> bool:
    """Return whether a tree imports modules or uses names that only Python 2 has."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import) and any(one.name in (*OLD_MODULES, "naoqi") for one in node.names):
            return True
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module in (*OLD_MODULES, "naoqi"):
            return True
        if isinstance(node, ast.Name) and node.id in _OLD_NAMES and isinstance(node.ctx, ast.Load):
            return True
        if isinstance(node, ast.Attribute) and node.attr in _OLD_METHODS:
            return True
    return False


def _translated(path: Path, source: str, first: SyntaxError | None) -> str:
    """Translate a text from Python 2 to Python 3, by Python's own translator or `fissix`."""
    package = next((name for name in ("lib2to3", "fissix") if find_spec(name) is not None), None)
    if package is None:
        reason = "is written in Python 2; translating it needs: pip install fissix"
        raise FileFormatError(path, reason, None if first is None else first.lineno)
    tool = _translator(package)
    try:
        text = str(tool.refactor_string(source.expandtabs(8).rstrip() + "\n", str(path)))
        ast.parse(text, str(path))
    except Exception as error:
        line, said = first.lineno if first is not None else None, first.msg if first is not None else error
        context = getattr(error, "context", None)  # set by the translator's parser, which reads Python 2
        if context:
            line, said = context[1][0], "invalid syntax"
        raise FileFormatError(path, f"is neither Python 3 nor Python 2: {said}", line) from error
    return text


@functools.cache
def _translator(package: str) -> Any:
    refactor = importlib.import_module(f"{package}.refactor")
    fixers = refactor.get_fixers_from_package(f"{package}.fixes")
    return refactor.RefactoringTool([one for one in fixers if not one.endswith(".fix_input")])


class _Interruptible(ast.NodeTransformer):
    """Transform `except:` to catch one interrupt only; otherwise loops around it would not end."""

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        self.generic_visit(node)
        if node.type is None:
            node.type = ast.copy_location(_call("__caught__", []), node)
        return node


class _OldMeaning(_Interruptible):
    """Transform operations to their meaning in Python 2.

    Args:
        whole: Whether the division of integers yields an integer.
    """

    def __init__(self, whole: bool) -> None:
        self._whole = whole
        self._functions = 0

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self._functions += 1
        self.generic_visit(node)
        self._functions -= 1
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        if not self._functions or node.level or node.names[0].name != "*":
            return node
        globals_ = _call("globals", [])
        call = _call("__import_all__", [ast.Constant(node.module), globals_])
        return ast.copy_location(ast.Expr(call), node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not (self._whole and isinstance(node.op, ast.Div)):
            return node
        return ast.copy_location(_call("__divided__", [node.left, node.right]), node)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        self.generic_visit(node)
        if not (self._whole and isinstance(node.op, ast.Div)):
            return node
        read = ast.parse(ast.unparse(node.target), mode="eval").body
        found = ast.Assign([node.target], _call("__divided__", [read, node.value]))
        return ast.copy_location(found, node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "str" and len(node.args) == 1:
            node.func.id = "__str__"
        if not isinstance(node.func, ast.Attribute):
            return node
        if node.func.attr in ("load", "loads"):  # of json, which has lost this parameter
            node.keywords = [one for one in node.keywords if one.arg != "encoding"]
        if node.func.attr not in _OF_STRINGS:
            return node
        first = [node.func.value, ast.Constant(node.func.attr)]
        return ast.copy_location(_call("__of_string__", [*first, *node.args], node.keywords), node)


def _call(name: str, arguments: Sequence[ast.expr], named: Sequence[ast.keyword] = ()) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(arguments), list(named))


def _divided(a: Any, b: Any) -> Any:
    return a // b if isinstance(a, int) and isinstance(b, int) else a / b


def _of_string(value: Any, method: str, *arguments: Any, **named: Any) -> Any:
    """Call a method of Python 2's strings, or the renamed method of a picture or an array."""
    if method in ("encode", "decode") and isinstance(value, str):
        codec = str(arguments[0] if arguments else named.get("encoding", "ascii"))
        if codec.replace("-", "_").lower() in ("hex", "hex_codec", "base64", "rot13", "string_escape"):
            coded = getattr(codecs, method)(value.encode("latin-1"), codec.replace("string", "unicode"))
            return coded.decode("latin-1") if isinstance(coded, bytes) else coded
        return value
    if method.startswith("from"):
        module = hasattr(value, "frombuffer")  # PIL.Image, with the bytes after mode and size, or numpy
        place = 2 if module and not hasattr(value, "ndarray") else 0
        arguments = tuple(
            one.encode("latin-1") if k == place and isinstance(one, str) and not named.get("sep") else one
            for k, one in enumerate(arguments)
        )
        if method == "fromstring" and not named.get("sep"):
            newer = "frombuffer" if module and place == 0 else "frombytes"
            method = newer if hasattr(value, newer) else method
    if method == "tostring" and hasattr(value, "tobytes"):
        return value.tobytes(*arguments, **named)
    return getattr(value, method)(*arguments, **named)


def _str(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes | bytearray) else str(value)


def _import_all(name: str, space: dict[str, Any]) -> None:
    """Import all names of a module into a namespace; Python 3 forbids `import *` in functions."""
    exec(f"from {name} import *", space)


def _next(it: Any, *default: Any) -> Any:
    """Return the next item of an iterator; the translator replaces every `x.next()` by `next(x)`."""
    return it.next() if hasattr(it, "next") and not hasattr(it, "__next__") else builtins.next(it, *default)


def _ord(character: Any) -> int:
    return character if isinstance(character, int) else builtins.ord(character)  # items of bytes are integers


def _round(number: float, digits: int = 0) -> float:
    scaled = abs(number) * 10.0**digits
    return math.copysign(math.floor(scaled + 0.5) / 10.0**digits, number) if math.isfinite(scaled) else number


def run(path: Path, space: dict[str, Any], reads: Callable[..., str]) -> None:
    """Run a program in a namespace.

    Args:
        path: File of the program.
        space: Namespace that receives the program's definitions.
        reads: Function that reads a typed line.
    """
    code, old = program(path)
    begin(code, old, space, reads)


def begin(code: types.CodeType, old: bool, space: dict[str, Any], reads: Callable[..., str]) -> None:
    """Run the code of a program with the built-in names of its version of Python."""
    names = vars(builtins) | {
        "basestring": str, "input": reads, "long": int, "raw_input": reads, "unicode": str, "xrange": range,
    }  # fmt: skip

    def execfile(path: str, globals: dict[str, Any] | None = None, locals: Any = None) -> None:
        inner = sys._getframe(1).f_globals if globals is None else globals
        exec(program(Path(path))[0], inner, inner if locals is None else locals)

    def evaluated(prompt: object = "") -> Any:
        text = reads(prompt)
        try:
            return eval(text, sys._getframe(1).f_globals)
        except (SyntaxError, NameError):
            return text  # as programs for both versions expect

    if old:
        names |= _OLD_BUILTINS | {"execfile": execfile, "input": evaluated}
    interrupts = 0

    def caught() -> type[BaseException]:
        nonlocal interrupts
        interrupts += isinstance(sys.exc_info()[1], KeyboardInterrupt)
        return BaseException if interrupts <= 1 else Exception

    names["__caught__"] = caught
    space["__builtins__"] = names
    exec(code, space)


_OLD_BUILTINS: dict[str, Any] = {
    "__divided__": _divided,
    "__import_all__": _import_all,
    "__of_string__": _of_string,
    "__str__": _str,
    "apply": lambda f, arguments=(), named=None: f(*arguments, **(named or {})),
    "buffer": memoryview,
    "cmp": lambda a, b: (a > b) - (a < b),
    "file": open,
    "intern": sys.intern,
    "next": _next,
    "ord": _ord,
    "reduce": functools.reduce,
    "reload": importlib.reload,
    "round": _round,
    "unichr": chr,
}


class ScriptImports(MetaPathFinder, Loader):
    """Finder of the modules in a script's folder, translated, and of the standard library by old names.

    Args:
        folder: Folder of the script.
        reads: Function that reads a typed line.
    """

    def __init__(self, folder: Path, reads: Callable[..., str]) -> None:
        self._folder, self._reads = str(folder.resolve()), reads
        self.loaded: list[str] = []

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return the specification of a module; None for modules of other finders."""
        spec = PathFinder.find_spec(name, [self._folder] if path is None else path)
        if spec is None or not str(spec.origin or "").startswith(self._folder):
            return ModuleSpec(name, self) if name in OLD_MODULES and spec is None else None
        self.loaded.append(name)
        if not str(spec.origin).endswith(".py"):
            return spec
        own = ModuleSpec(
            name, self, origin=spec.origin, is_package=spec.submodule_search_locations is not None
        )
        own.submodule_search_locations = spec.submodule_search_locations
        own.has_location = True
        return own

    def exec_module(self, module: types.ModuleType) -> None:
        """Run a module's program, or copy the contents of a renamed module."""
        name, origin = module.__name__, getattr(module.__spec__, "origin", None)
        if origin is None:
            self.loaded.append(name)
            for new in OLD_MODULES[name]:
                contents = vars(importlib.import_module(new)).items()
                module.__dict__.update({key: value for key, value in contents if key[:2] != "__"})
        else:
            run(Path(origin), module.__dict__, self._reads)
