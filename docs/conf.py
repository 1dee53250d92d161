"""How the site is built: ``sphinx-build -W -n --keep-going -b html docs build/site``."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

from davis_rs import __version__  # noqa: E402  (after the path of the extensions)

project = "davis_rs"
author = "the authors of davis_rs"
version = release = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_argparse_cli",
    "public_names",
    "readable_autodoc",
    "repository_links",
]
exclude_patterns = ["conf.py", "extensions"]
nitpicky = True

# Names of other libraries. The build fetches nothing, so it has no list of theirs.
nitpick_ignore_regex = [
    (r"py:.*", r"(abc|argparse|collections|datetime|enum|os|pathlib|types|typing)\..*|Path"),
    (r"py:.*", r"(drjit|dr|matplotlib|mi|mitsuba|np|npt|numpy|torch|usb)\..*|Client|Figure"),
]

autodoc_default_options = {"members": True, "show-inheritance": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
napoleon_numpy_docstring = False
napoleon_use_ivar = False
napoleon_use_param = False

suppress_warnings = ["toc.empty_glob"]  # without tutorials
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
highlight_language = "none"
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"davis_rs {release}"
html_copy_source = False
