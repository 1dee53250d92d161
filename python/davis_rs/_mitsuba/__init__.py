"""Wraps Mitsuba 3: chooses its variant and LLVM, and checks files before it opens them.

``variants`` imports Mitsuba late and sets a variant for a block; ``llvm`` finds the library (named by the user, the
system's, or that of the Rust toolchain which built the package); ``files`` refuses what would end the process;
``types`` names Mitsuba's objects for signatures.

Dr.Jit needs a libLLVM that wheels cannot bring. The toolchain of rustup has one that exports what Dr.Jit needs,
and ``rust/build.rs`` notes its path. The system's own library comes first.
"""
