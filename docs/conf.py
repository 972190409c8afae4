"""How Sphinx builds the documentation: `make docs`."""

import os

from tablesetting import __version__

# The reference imports everything; nothing is rendered.
os.environ.setdefault("MUJOCO_GL", "disable")

project = "tablesetting"
author = copyright = "The tablesetting developers"
release = __version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"tablesetting {__version__}"
myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_use_ivar = True
# Links of the pages that lead out of the documentation, into the repository.
suppress_warnings = ["myst.xref_missing"]
