"""Memory with a page that may not be touched at one of its ends, for all arrays of NumPy and of machine code.

`guard("after")` puts every new array right in front of such a page, `guard("before")` right behind one: a
read or a write past that end is a fault.  What is freed is unmapped, so that a later use is a fault too.
New memory that is not asked to be zero is full of 0xFF, NaN as numbers and -1 as integers; large arrays only
in the 64 kB at both ends.
"""

import ctypes
from typing import Any

import llvmlite.binding as llvm
import numpy as np

PAGE = 4096
SIDES = ("after", "before")
"""Which end of an array has the guard page."""

# after:   [ data pages: ... header | array ][ guard ]
# before:  [ header page ][ guard ][ data pages: array | ... ]
# The header is 32 bytes: start and length of the mapping, size of the array, a mark.
_COMMON = """
declare i8* @mmap(i8*, i64, i32, i32, i32, i64)
declare i32 @mprotect(i8*, i64, i32)
declare i32 @munmap(i8*, i64)
declare void @abort()
declare i8* @memcpy(i8*, i8*, i64)
declare void @llvm.memset.p0i8.i64(i8*, i8, i64, i1)

define void @note(i8* %header, i8* %map, i64 %length, i64 %size) {
  %words = bitcast i8* %header to i64*
  %start = ptrtoint i8* %map to i64
  store i64 %start, i64* %words, align 1
  %second = getelementptr i64, i64* %words, i64 1
  store i64 %length, i64* %second, align 1
  %third = getelementptr i64, i64* %words, i64 2
  store i64 %size, i64* %third, align 1
  %fourth = getelementptr i64, i64* %words, i64 3
  store i64 81985529216486895, i64* %fourth, align 1
  ret void
}
define i64* @header_of(i8* %data) {
  %header = getelementptr i8, i8* %data, i64 HEADER
  %words = bitcast i8* %header to i64*
  %fourth = getelementptr i64, i64* %words, i64 3
  %mark = load i64, i64* %fourth, align 1
  %good = icmp eq i64 %mark, 81985529216486895
  br i1 %good, label %fine, label %damaged
fine:
  ret i64* %words
damaged:
  call void @abort()
  unreachable
}
define void @fill(i8* %start, i64 %size, i8 %content, i64 %most) {
  %small = icmp ult i64 %size, %most
  %count = select i1 %small, i64 %size, i64 %most
  %skipped = sub i64 %size, %count
  %end = getelementptr i8, i8* %start, i64 %skipped
  call void @llvm.memset.p0i8.i64(i8* %start, i8 %content, i64 %count, i1 0)
  call void @llvm.memset.p0i8.i64(i8* %end, i8 %content, i64 %count, i1 0)
  ret void
}
define i8* @guarded(i64 %asked, i8 %content) {
  %none = icmp eq i64 %asked, 0
  %size = select i1 %none, i64 1, i64 %asked
  %room = add i64 %size, ROOM
  %up = add i64 %room, 4095
  %pages = and i64 %up, -4096
  %length = add i64 %pages, EXTRA
  %map = call i8* @mmap(i8* null, i64 %length, i32 3, i32 16418, i32 -1, i64 0)
  %address = ptrtoint i8* %map to i64
  %failed = icmp eq i64 %address, -1
  br i1 %failed, label %out, label %go
go:
  ADDRESSES
  %refused = call i32 @mprotect(i8* %guard, i64 4096, i32 0)
  %broken = icmp ne i32 %refused, 0
  br i1 %broken, label %out, label %fill
fill:
  call void @fill(i8* %first, i64 %pages, i8 -1, i64 65536)
  call void @fill(i8* %data, i64 %size, i8 %content, i64 73728)
  call void @note(i8* %header, i8* %map, i64 %length, i64 %size)
  ret i8* %data
out:
  ret i8* null
}
define i8* @guard_malloc(i8* %context, i64 %size) {
  %data = call i8* @guarded(i64 %size, i8 -1)
  ret i8* %data
}
define i8* @guard_calloc(i8* %context, i64 %count, i64 %item) {
  %size = mul i64 %count, %item
  %data = call i8* @guarded(i64 %size, i8 0)
  ret i8* %data
}
define void @guard_free(i8* %context, i8* %data, i64 %unused) {
  %none = icmp eq i8* %data, null
  br i1 %none, label %out, label %go
go:
  %words = call i64* @header_of(i8* %data)
  %start = load i64, i64* %words, align 1
  %second = getelementptr i64, i64* %words, i64 1
  %length = load i64, i64* %second, align 1
  %map = inttoptr i64 %start to i8*
  %done = call i32 @munmap(i8* %map, i64 %length)
  br label %out
out:
  ret void
}
define i8* @guard_realloc(i8* %context, i8* %data, i64 %size) {
  %new = call i8* @guarded(i64 %size, i8 -1)
  %none = icmp eq i8* %data, null
  br i1 %none, label %out, label %copy
copy:
  %words = call i64* @header_of(i8* %data)
  %third = getelementptr i64, i64* %words, i64 2
  %before = load i64, i64* %third, align 1
  %less = icmp ult i64 %before, %size
  %common = select i1 %less, i64 %before, i64 %size
  %copied = call i8* @memcpy(i8* %new, i8* %data, i64 %common)
  call void @guard_free(i8* null, i8* %data, i64 0)
  br label %out
out:
  ret i8* %new
}
define i8* @code_malloc(i64 %size) {
  %data = call i8* @guarded(i64 %size, i8 -1)
  ret i8* %data
}
define i8* @code_aligned_alloc(i64 %alignment, i64 %size) {
  %data = call i8* @guarded(i64 %size, i8 -1)
  ret i8* %data
}
define void @code_free(i8* %data) {
  call void @guard_free(i8* null, i8* %data, i64 0)
  ret void
}
"""
_PLACES = {
    "after": {
        "ROOM": "64",
        "EXTRA": "4096",
        "HEADER": "-32",
        "ADDRESSES": """
  %first = getelementptr i8, i8* %map, i64 0
  %guard = getelementptr i8, i8* %map, i64 %pages
  %back = sub i64 %pages, %size
  %data = getelementptr i8, i8* %map, i64 %back
  %header = getelementptr i8, i8* %data, i64 -32
""",
    },
    "before": {
        "ROOM": "0",
        "EXTRA": "8192",
        "HEADER": "-8192",
        "ADDRESSES": """
  %header = getelementptr i8, i8* %map, i64 0
  %guard = getelementptr i8, i8* %map, i64 4096
  %data = getelementptr i8, i8* %map, i64 8192
  %first = getelementptr i8, i8* %map, i64 8192
""",
    },
}


class _Allocator(ctypes.Structure):
    """`PyDataMemAllocator`."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in ("context", "malloc", "calloc", "realloc", "free"))


class _Handler(ctypes.Structure):
    """`PyDataMem_Handler` (NEP 49)."""

    _fields_ = (("name", ctypes.c_char * 127), ("version", ctypes.c_uint8), ("allocator", _Allocator))


_SET_HANDLER = 304  # its place in NumPy's table of C functions
_kept: list[Any] = []


def guard(side: str) -> None:
    """Give all new arrays of this thread, and of machine code loaded from now on, a guard page.

    Args:
        side: "after" or "before": which end.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    text = _COMMON
    for name, value in _PLACES[side].items():
        text = text.replace(name, value)
    machine = llvm.Target.from_default_triple().create_target_machine(opt=2)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(text), machine)
    engine.finalize_object()
    address = engine.get_function_address
    handler = _Handler(b"guarded", 1)
    for name in ("malloc", "calloc", "realloc", "free"):
        setattr(handler.allocator, name, address(f"guard_{name}"))
    for name in ("malloc", "aligned_alloc", "free"):
        llvm.add_symbol(name, address(f"code_{name}"))
    _kept.extend((engine, handler))
    python = ctypes.pythonapi
    python.PyCapsule_New.restype = ctypes.py_object
    python.PyCapsule_New.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    capsule = python.PyCapsule_New(ctypes.addressof(handler), b"mem_handler", None)
    python.PyCapsule_GetPointer.restype = ctypes.c_void_p
    python.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    table = python.PyCapsule_GetPointer(np._core.multiarray._ARRAY_API, None)
    functions = (ctypes.c_void_p * (_SET_HANDLER + 1)).from_address(table)
    set_handler = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.py_object)(functions[_SET_HANDLER])
    _kept.extend((capsule, set_handler(capsule)))
    handler_name = np._core.multiarray.get_handler_name(np.empty(3))
    if handler_name != "guarded":
        raise RuntimeError(f"NumPy's arrays come from {handler_name!r}")
