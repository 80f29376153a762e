"""Configuration of the book. `docs/build` builds it."""

import os
import re
import sys
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
# The Python package is read from its source. Its compiled part is replaced by a stand-in, so that nothing is compiled.
sys.path.insert(0, str(ROOT / "python/package"))
autodoc_mock_imports = ["modulo_camera._core"]

project = "modulo"
author = "The developers of modulo"
project_copyright = "The developers of modulo, Apache-2.0"
release = re.search(r'^version = "(.+)"', (ROOT / "Cargo.toml").read_text(), re.MULTILINE).group(1)
version = release

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["machines"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
# The notebook has the results of its last run, which `python/check` repeats.
nb_execution_mode = "off"
highlight_language = "none"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"modulo {release}"
html_show_sphinx = False
html_copy_source = False
html_static_path = ["book.css"]
html_css_files = ["book.css"]
html_theme_options = {"source_directory": "docs/"}

# The address of the repository's files, such as https://example.org/modulo/blob/main; links from the book to files outside of docs/ lead
# there. Without it they are shown as paths.
REPOSITORY = os.environ.get("MODULO_REPOSITORY", "").rstrip("/")
# The notebook is a page of the book, by a symbolic link in docs/tutorials.
NOTEBOOK = ROOT / "python/examples/radiance_to_boxes.ipynb"
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(((?:\.\./)+[^)#\s]*)(#[^)\s]*)?\)")


def lead_outside(app: Sphinx, docname: str, source: list[str]) -> None:
    """Replaces links to files of the repository outside of docs/, and warns of those that are not there."""

    def replaced(link: re.Match[str]) -> str:
        text, path, anchor = link[1], link[2], link[3] or ""
        target = ((DOCS / docname).parent / path).resolve()
        if target.is_relative_to(DOCS):
            return link[0]
        if target == NOTEBOOK:
            return f"{{doc}}`{text} </tutorials/radiance-to-boxes>`"
        if not target.exists():
            logging.getLogger(__name__).warning("there is no %s", path, location=docname)
        place = target.relative_to(ROOT).as_posix()
        if REPOSITORY:
            return f"[{text}]({REPOSITORY}/{place}{anchor})"
        return f"`{place}`" if text.strip("`") in place else f"{text} (`{place}`)"

    if app.env.doc2path(docname).suffix == ".md":
        source[0] = LINK.sub(replaced, source[0])


def setup(app: Sphinx) -> None:
    """Connects the replacement of links."""
    app.connect("source-read", lead_outside)
