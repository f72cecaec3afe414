"""The files that the page is put together from; read by the Snakefile, so nothing heavy here."""

TEMPLATE = "page.html.j2"
STYLES = ("vendor/uplot.min.css", "assets/page.css")
SCRIPTS = (
    "assets/unpack.js",
    "assets/overview.js",
    "assets/curves.js",
    "assets/gallery.js",
    "assets/viewer.js",
    "assets/page.js",
)
LIBRARIES = {"uplot": "vendor/uplot.min.js", "three": "vendor/three.min.js"}  # run when needed
PARTS = (TEMPLATE, *STYLES, *SCRIPTS, *LIBRARIES.values())
