"""How the site is built: ``sphinx-build -W -n --keep-going -b html docs build/site``."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

from sphinx.application import Sphinx

from davis_rs import __version__

# Kernels of notebooks would warn that a debugger, which nobody attaches, may miss breakpoints.
os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")
# They would warn that they talk to this process without encryption, too; errors are still told.
if "IPYTHONDIR" not in os.environ:
    os.environ["IPYTHONDIR"] = tempfile.mkdtemp(prefix="davis_rs_site_")
    atexit.register(shutil.rmtree, os.environ["IPYTHONDIR"], ignore_errors=True)
    profile = Path(os.environ["IPYTHONDIR"], "profile_default")
    profile.mkdir()
    (profile / "ipython_kernel_config.py").write_text("get_config().IPKernelApp.log_level = 40\n")
sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "davis_rs"
author = "the authors of davis_rs"
copyright = author
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
    "command_blocks",
]
nitpicky = True

# Names of other libraries. The build fetches nothing, so it has no list of theirs.
nitpick_ignore_regex = [
    (r"py:.*", r"(abc|argparse|collections|datetime|enum|os|pathlib|types|typing)\..*|Path(Like)?"),
    (r"py:.*", r"(drjit|dr|gymnasium|matplotlib|mi|mitsuba|np|npt|numpy|scipy|torch|usb)\..*|Client|Figure|csr_array"),
    # Parts of the package that signatures name and users are not handed.
    (
        r"py:.*",
        r"davis_rs\.(_mitsuba\.files\.XmlFile|_util\.(argument_error\.(Argument|NamesArguments)|whole_file\.Workplace)"
        r"|differentiable\.(event_levels\.EventLevels|log_luma\.LogLuma(Field)?)"
        r"|simulation\.(planning\.luma_sample\.LumaSample|settings\.resolve\.Resolved)"
        r"|io\.formats\.(blocks\.Blocks|destination\.PartFile|interface\.Releasable)"
        r"|scene\.mesh_part\.(Blend|Glass|MetalRoughness|NormalTexture)|render\.(edges\.(neighbours\.ImageMap|swept_objects\.MovingSilhouettes)"
        r"|motion\.scene_motion\.SceneMotion)|sampling\.(breaks\.Break|keyframes\.SparseSamples)"
        r"|usb\.(link\.UsbLink|protocol\.Write)|data\.windows\.window\._Image)|Resolved|SampleArray|SparseSamples",
    ),
]

autodoc_default_options = {"members": True, "show-inheritance": True, "member-order": "bysource"}
autodoc_mock_imports = ["torch"]  # an extra that would be large for a base class's name
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
toc_object_entries_show_parents = "hide"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
napoleon_numpy_docstring = False
napoleon_use_ivar = False
napoleon_use_param = False

myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
if tags.has("quick"):  # noqa: F821
    nb_execution_mode = "off"  # .ci/nightly runs the notebooks
highlight_language = "none"
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"davis_rs {release}"
html_copy_source = False
html_static_path = ["site.css", "fold.js"]
html_css_files = ["site.css"]
html_js_files = ["fold.js"]
html_search_scorer = str(Path(__file__).with_name("search_scores.js"))


def without_tutorials(app: Sphinx, name: str, content: list[str]) -> None:
    """A page that is not there is a warning of Sphinx; without notebooks the index has none."""
    if name == "index" and not any(page.startswith("tutorials/") for page in app.env.found_docs):
        content[0] = re.sub(r"   tutorials/\S+\n", "", content[0])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", without_tutorials)
