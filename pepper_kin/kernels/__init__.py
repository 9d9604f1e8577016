"""CasADi SX function -> SIMD machine code -> arrays.

    import casadi
    from pepper_kin.kernels import compile_function

    x = casadi.SX.sym("x", 3)
    kernel = compile_function(casadi.Function("f", [x], [casadi.sin(x) * casadi.sumsqr(x)]))
    y = kernel(numpy.ones((1_000_000, 3)))      # (1_000_000, 3)

A CasADi function of SX expressions is a list of scalar instructions.  Each becomes one vector instruction
that works on several states at once; the code is made at run time by LLVM, without a C compiler, and kept on
disk.  This package is independent of robots: it needs numpy, casadi and llvmlite only, and `native.py`, for
callers that Numba compiles, Numba.  See `docs/kernels.md`.

    compile_function, Kernel, Signature, kernel_ir    of CasADi functions
    compiled, CompiledFunction, units         of Python functions, through Numba
    Target, host_target, make_target          processors
    cache_folder, clear_cache, CACHE_VARIABLE, source_digest, release_memory
    SUPPORTED_OPERATIONS, UnsupportedInstructionError
"""

from pepper_kin.kernels.compiled_function import CompiledFunction, compiled, units
from pepper_kin.kernels.instructions import SUPPORTED_OPERATIONS, Signature, UnsupportedInstructionError
from pepper_kin.kernels.kernel import Kernel, compile_function, kernel_ir
from pepper_kin.kernels.memory import release_memory
from pepper_kin.kernels.sources import source_digest
from pepper_kin.kernels.store import CACHE_VARIABLE, cache_folder, clear_cache
from pepper_kin.kernels.target import Target, host_target, make_target

__all__ = [
    "CACHE_VARIABLE",
    "SUPPORTED_OPERATIONS",
    "CompiledFunction",
    "Kernel",
    "Signature",
    "Target",
    "UnsupportedInstructionError",
    "cache_folder",
    "clear_cache",
    "compile_function",
    "compiled",
    "host_target",
    "kernel_ir",
    "make_target",
    "release_memory",
    "source_digest",
    "units",
]
