"""Runs ``python -m davis_rs.cli``."""

import sys

from .main import main

sys.exit(main())
