"""Configuration of Sphinx; `tox -e docs` builds the pages."""

import re
import sys
import unicodedata
from pathlib import Path
from xml.etree import ElementTree

from docutils import nodes
from latex2mathml.converter import convert

import suslov_fast

sys.path.insert(0, str(Path(__file__).parent))
import as_notebook
from files import tables

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
]
exclude_patterns = ["_build", "examples"]
templates_path = ["_templates"]

myst_enable_extensions = ["amsmath", "dollarmath"]
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
    "header_links_before_dropdown": 7,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_show_sourcelink = False
wide = (
    "index howto/equations howto/first_ode suslov gallery architecture performance "
    "bibliography changelog summary search genindex"
)
html_sidebars = {page: [] for page in wide.split()}

copybutton_exclude = ".linenos, .gp, .go"


MATHML = "http://www.w3.org/1998/Math/MathML"
ElementTree.register_namespace("", MATHML)
FIGURE = re.compile(r'class="reference download internal" download="" (?=href="[^"]*\.png")')
END_OF_FORMULA = re.compile(r"(</math>)(</span>)([.,;:)]+)")
NUMBER_OR_OPTION = re.compile(r"(?<![\w.-])(\d[\d.]*e-\d+|--[a-z][\w-]*)(?!\w)(?=[^<>]*<)")
CODE = re.compile(r'<span class="pre">([^<]+)')
PARTS = re.compile(r"(?<=\w[_.(/=])(?=[\w&.])(?!\w{1,3}\b)")
LETTERS = re.compile("[A-Za-z]{2,}|\N{INFINITY}")
SIGNATURE = re.compile(r"(?<=</code></a>)[^<]+")


def finish(app, page, template, context, doctree):
    """Let a click on a figure open it, and lines break where readers expect it.

    MyST makes a download of each link to a file.
    """
    if "body" in context:
        body = context["body"].replace("</a>()</p></td>", "</a></p></td>")  # of classes
        body = END_OF_FORMULA.sub(r"\1\3\2", FIGURE.sub("", body))
        body = NUMBER_OR_OPTION.sub(r'<span class="whole">\1</span>', body)
        body = CODE.sub(word_of_code, body)
        if (name := page.rpartition("/")[2]) in as_notebook.PAGES:
            link = f'<p><a href="{name}.ipynb" download>This page as a notebook</a></p>'
            body = body.replace("</p>", f"</p>\n{link}", 1)  # below the first paragraph
        context["body"] = SIGNATURE.sub(lambda found: found[0].replace("\xa0", " "), body)


def word_of_code(found):
    """Break a long word of code between its parts, and never within an option or '.[extra]'."""
    word = found[1]
    if re.search(r"-|\.\[", word) and len(word) < 36:
        return f'<span class="pre whole">{word}'
    return f'<span class="pre">{PARTS.sub("<wbr>", word) if len(word) > 15 else word}'


def is_function(node):
    """Say whether a node of MathML is the name of a function, such as sin, or a power of it."""
    while len(node) and re.search("msu[bp]$", node.tag):
        node = node[0]
    return node.tag.endswith("}mi") and re.fullmatch("[A-Za-z]{2,}", node.text or "")


def spaced(formula):
    """Space a formula of latex2mathml as TeX does."""
    root = ElementTree.fromstring(formula)
    for node in root.iter():
        if len(node) and node[-1].text == "\N{PRIME}":  # raised already: no superscript
            node[-1].tag, node[-1].attrib = f"{{{MATHML}}}mo", {"lspace": "0", "rspace": "0"}
            if node.tag.endswith("}msubsup"):
                base = ElementTree.Element(f"{{{MATHML}}}msub")
                base.extend(node[:2])
                node[:2] = [base]
            node.tag = f"{{{MATHML}}}mrow"
        elif node.get("mathvariant") == "double-struck":  # a variant that browsers ignore
            letter = f"MATHEMATICAL DOUBLE-STRUCK CAPITAL {node.text}"
            node.text = unicodedata.lookup(letter)
        elif node.text == ";":
            node.tag, node.attrib = f"{{{MATHML}}}mo", {"lspace": "0", "rspace": "0.167em"}
        elif node.text in [*"/|\N{DOUBLE VERTICAL LINE}\N{HORIZONTAL ELLIPSIS}"]:
            node.attrib |= {"lspace": "0", "rspace": "0", "stretchy": "false"}
        elif node.tag.endswith("}mo") and re.fullmatch(LETTERS, node.text or ""):
            node.tag, node.attrib = f"{{{MATHML}}}mi", {}
    rows = [node for node in root.iter() if re.search("}m(row|style|td|sqrt)$", node.tag)]
    for row in rows:
        for k in reversed(range(len(row) - 1)):
            left, right = row[k], row[k + 1]
            signed = left.tag.endswith("}mo") and left.text not in [*")]|\N{HORIZONTAL ELLIPSIS}"]
            if signed and right.text in ("+", "\N{MINUS SIGN}"):
                right.set("form", "prefix")
            apart = [right] if left.text == ")" else [left, right]
            beside = is_function(left) or is_function(right)
            if beside and not any(re.search("}(mo|mspace)$", node.tag) for node in apart):
                row.insert(k + 1, ElementTree.Element(f"{{{MATHML}}}mspace", width="0.167em"))
    return ElementTree.tostring(root, encoding="unicode")


def mathml(display):
    """Write formulas as MathML: browsers need no script and fetch nothing.

    Displayed formulas side by side stand below each other on a phone.
    """

    def write(self, node):
        tag = "div" if display == "block" else "span"
        text = node.astext()
        parts = text.split(r"\qquad") if display == "block" else [text]
        formulas = "".join(spaced(convert(part, display=display)) for part in parts)
        self.body.append(f'<{tag} class="formula">{formulas}</{tag}>')
        raise nodes.SkipNode

    return write, None


RESULTS = set(
    "Trajectories Contraction HKBasis ImplicitIntegral KahanMap Locus PlanarEntropy "
    "RationalFunction RationalMap Report SingularStepError Field Motion Events".split()
)


def signature(app, what, name, *_):
    """Leave out the arguments of classes of which functions make the objects."""
    return ("", None) if name.rpartition(".")[2] in RESULTS else None


def straight_quotes(app, docname, _):
    """Leave quotes in docstrings as they are: most belong to code, or are primes."""
    app.config.smartquotes = not docname.startswith("reference/")


def with_files(app, docname, source):
    """Add the table of files to the page that is about them."""
    if docname == "architecture":
        source[0] = source[0].replace("## Rules\n", f"### Files\n\n{tables()}\n\n## Rules\n")


def write_notebooks(app, exception):
    """Write a notebook beside each page that links to one."""
    if exception is None and app.builder.format == "html":
        for page in as_notebook.PAGES.values():
            target = Path(app.outdir) / page.relative_to(as_notebook.DOCS).with_suffix(".ipynb")
            as_notebook.write(page, target)


def setup(app):
    """Register MathML as the format of formulas, and links to figures and signatures."""
    app.add_html_math_renderer("mathml", mathml("inline"), mathml("block"))
    app.connect("html-page-context", finish)
    app.connect("autodoc-process-signature", signature)
    app.connect("source-read", straight_quotes)
    app.connect("source-read", with_files)
    app.connect("build-finished", write_notebooks)


html_math_renderer = "mathml"
