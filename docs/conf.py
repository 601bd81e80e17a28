# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The site of the documents and of the library: .ci/docs builds it."""

from maxcon._system.version import __version__

project = "maxcon"
author = "the maxcon authors"
copyright = "2026 the maxcon authors"
version = release = __version__

extensions = ["sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc", "myst_parser"]
html_theme = "furo"
html_title = f"maxcon {__version__}"
exclude_patterns = ["_build", "README.md"]  # index.md is the site's list of pages
html_copy_source = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say of each parameter what it is
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
default_role = "code"

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
highlight_language = "none"  # of blocks that name none: what was printed
