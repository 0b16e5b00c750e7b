"""The documentation site: `make docs`. Pages are Markdown that reads well on a code host too."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import rsdeblur  # noqa: E402

project = "rsdeblur"
author = "rsdeblur developers"
project_copyright = "rsdeblur developers, BSD 3-Clause"
version = release = rsdeblur.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",  # the source of every public name
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "numpydoc",
    "sphinx-mathjax-offline",  # formulas without a network
    "generated",
]
exclude_patterns = ["_*", "**/data", "gallery"]
nitpicky = True
suppress_warnings = ["myst.header"]  # tables made by benchmarks start below their page's levels

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_typehints = "none"  # numpydoc's sections say more than annotations
default_role = "code"  # numpydoc writes names in single backticks
numpydoc_show_class_members = False  # `:members:` lists them
# Every public function, method and class documents every parameter, in order. The form of docstrings is checked by
# `make lint`: tool.numpydoc_validation in pyproject.toml.
numpydoc_validation_checks = {"PR01", "PR02", "PR03"}
numpydoc_validation_exclude = {
    r"\.((Quadratic|Gradient|Prior)Solver|LatentPrior)$",  # protocols: their constructor is not theirs
    r"\.Options$",  # its fields are the keywords of deblur, which describes them
    r"\.Plan$",  # has a private field
    r"(?<!LatentPrior)(?<!QuadraticSolver)\.(restore|with_peak_of|solve|observe|combine)$",  # deconv describes them
}

# Examples of docs/gallery, run when the site is built; every picture comes from simulated captures.
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": "",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib",),
    "matplotlib_animations": False,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "reset_modules": (),
    "remove_config_comments": True,
    "backreferences_dir": None,
    "doc_module": (),
}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "pydata_sphinx_theme"
LOGO = "_static/favicon.svg"
html_title = "rsdeblur"
html_context = {"default_mode": "auto"}
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "_static" / "scorer.js")
html_js_files = [("names.js", {"defer": "defer"})]
html_show_sourcelink = False
html_sidebars = {"comparison": []}
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": {"**": ["page-toc"], "comparison": []},  # its tables need the room
    "logo": {"text": f"rsdeblur {version}", "image_light": LOGO, "image_dark": LOGO},
    "icon_links": [
        # Read the Docs names the repository that it builds; other builders do not know one.
        {"name": "Repository", "url": url.removesuffix(".git"), "icon": "fa-solid fa-code"}
        for url in (os.environ.get("READTHEDOCS_GIT_CLONE_URL", ""),)
        if url.startswith("https://")
    ],
}
