"""Adds to the site what is made from the code."""

from mkdocs.structure.files import File, Files

from silmesh.manual import describe_configuration

CONFIGURATION = """# Configuration

One file in YAML, given as `bin/run --configfile my.yaml`. An unknown key is refused with the
nearest known one, a wrong value with what would be right, before anything is made. A dot stands for
a section: `views.size: 256` is written `views: {size: 256}`. A variant may have the run's sections,
too: each key that it gives there overrides the run's, and what it does not say is as the run says,
or the object's row of the [table](files.md#the-table).

"""


def on_files(files: Files, config: dict) -> Files:
    """Add the page of the configuration's keys."""
    page = CONFIGURATION + describe_configuration()
    files.append(File.generated(config, "configuration.md", content=page))
    return files
