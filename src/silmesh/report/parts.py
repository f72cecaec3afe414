"""The files that the page is put together from; read by the Snakefile, so nothing heavy here."""

PAGE = "page.html.j2"
BASE = "base.html.j2"  # of the page and of the index
LISTED = 50  # a report of more objects is an index, and a page of each
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
PARTS = (PAGE, BASE, *STYLES, *SCRIPTS, *LIBRARIES.values())
