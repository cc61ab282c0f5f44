"""Settings of the site: `make docs` builds it into results/docs, without network."""

import sys
from importlib.metadata import version as installed
from pathlib import Path


ROOT = Path(__file__).resolve().parents[1]
# Code and documentation are of one commit, also where another version is installed.
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

project = "jaxthermo"
author = "the jaxthermo authors"
version = release = installed("jaxthermo")
html_title = f"jaxthermo {release}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "extension.figures",
    "extension.mathml",
    "extension.measured",
    "extension.tags",
    "extension.generated",
]
exclude_patterns = ["extension", "data", "examples"]
default_role = "code"

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]

autodoc_inherit_docstrings = False
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
# Beyond it each argument has a line of its own.
maximum_signature_line_length = 88
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
add_module_names = False
toc_object_entries = False

html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "default"
