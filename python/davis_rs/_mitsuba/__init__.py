"""Mitsuba 3: which variant and which LLVM are used, and what is checked before it opens a file.

``variants`` imports Mitsuba late and sets a variant for a block; ``llvm`` finds the library (named by the user, the
system's, or that of the Rust toolchain which built the package); ``files`` refuses what would end the process.

Dr.Jit needs a libLLVM that wheels cannot bring. The toolchain of rustup has one that exports what Dr.Jit asks for,
and ``rust/build.rs`` notes where it lies. The system's own comes first.
"""
