"""The documentation site: `make docs`. Pages are Markdown that reads well on a code host too."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
# Help texts are wrapped to the terminal that asks; here there is none.
os.environ["COLUMNS"] = "100"

import rsdeblur  # noqa: E402

project = "rsdeblur"
author = "rsdeblur developers"
project_copyright = "rsdeblur developers, BSD 3-Clause"
version = release = rsdeblur.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "generated"]
exclude_patterns = ["_*", "**/data"]
nitpicky = True
suppress_warnings = ["myst.header"]  # tables made by benchmarks start below their page's levels

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autosummary_ignore_module_all = False  # `rsdeblur` itself holds nothing but imported names
autodoc_typehints = "none"  # numpydoc's sections say more than annotations
autodoc_class_signature = "separated"
default_role = "code"  # numpydoc writes names in single backticks
numpydoc_show_class_members = False  # the template lists them
templates_path = ["_templates"]

html_theme = "pydata_sphinx_theme"
html_title = "rsdeblur"
html_show_sourcelink = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "icon_links": [],
}
