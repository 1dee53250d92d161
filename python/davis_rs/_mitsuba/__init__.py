"""Mitsuba 3: which variant and which LLVM are used, and what is checked before it opens a file."""
