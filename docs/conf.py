"""Configuration of Sphinx; `tox -e docs` builds the pages."""

import sys
import warnings
from pathlib import Path

import matplotlib
from docutils import nodes
from latex2mathml.converter import convert
from sphinx_gallery.scrapers import figure_rst

matplotlib.use("Agg")
sys.path.insert(0, str(Path(__file__).parent))

import as_notebook

import suslov_fast

project = "suslov_fast"
author = "The suslov_fast developers"
project_copyright = author
version = release = suslov_fast.__version__
html_title = f"suslov_fast {version}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "examples", "gallery/**/*.ipynb", "gallery/*.py.md5"]
templates_path = ["_templates"]

myst_enable_extensions = ["amsmath", "dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

# Docstrings state the types of parameters, with their shapes.
autodoc_typehints = "none"
autosummary_generate = True
numpydoc_show_class_members = False
nitpicky = True

html_theme = "pydata_sphinx_theme"
html_theme_options = {
    "show_prev_next": True,
    "show_toc_level": 2,
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_show_sourcelink = False
wide = "index start architecture performance bibliography changelog citing search genindex"
html_sidebars = {page: [] for page in wide.split()}

copybutton_exclude = ".linenos, .gp, .go"


def middle_frame(block, block_vars, gallery_conf):
    """Save the middle frame of an animation, whose figure pyplot does not know."""
    animation = block_vars["example_globals"].get("animation")
    if animation is None:
        return ""
    frames = list(animation.new_frame_seq())
    animation._func(frames[len(frames) // 2])
    path = next(block_vars["image_path_iterator"])
    animation._fig.savefig(path, dpi=100)
    return figure_rst([path], gallery_conf["src_dir"])


def mathml(display):
    """Write formulas as MathML: browsers need no script and fetch nothing."""

    def write(self, node):
        tag = "div" if display == "block" else "span"
        formula = convert(node.astext(), display=display)
        self.body.append(f'<{tag} class="formula">{formula}</{tag}>')
        raise nodes.SkipNode

    return write, None


def setup(app):
    """Register MathML as the format of formulas."""
    app.add_html_math_renderer("mathml", mathml("inline"), mathml("block"))


html_math_renderer = "mathml"

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "matplotlib_animations": (True, "jshtml"),
    "download_all_examples": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "show_memory": False,
    "show_signature": False,
    "plot_gallery": True,
    "remove_config_comments": True,
    "image_scrapers": (middle_frame, "matplotlib"),
    "capture_repr": ("_repr_html_",),
}
suppress_warnings = ["config.cache"]

# The tutorial as a download.
as_notebook.write(Path(__file__).parent / "_build" / "tutorial.ipynb")

# Warnings in the examples are errors, as in the tests.
warnings.filterwarnings("error", category=RuntimeWarning)
