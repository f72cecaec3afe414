"""Adds to the site what is made from the code."""

from mkdocs.structure.files import File, Files

from silmesh.planning.manual import describe_configuration

CONFIGURATION = """# Configuration

One file in YAML, given as `bin/run --configfile my.yaml`. An unknown key is refused with the
nearest known one, a wrong value with what would be right, before anything is made. A dot stands for
a section: `views.size: 256` is written `views: {size: 256}`. A variant may have the run's sections,
too: each key that it gives there overrides the run's, and what it does not say is as the run says,
or the object's row of the [table](files.md#the-table). All keys but `datasets` and `variants` have
defaults:

```yaml
datasets: my.tsv                  # relative to the project's folder, where bin/run works
views: {size: 256, resize: pad}   # pad keeps the aspect, stretch fills the square
variants:                         # every object runs every variant unless its row names fewer
  sphere:
    init: {shape: sphere, vertices: auto, align: bbox}
    fit: {preset: fast}
```

More is said of `quality` in [Silhouettes](silhouettes.md#policy), of `matting`
[there too](silhouettes.md#the-foreground-model), of `deeplab` and `train` in
[DeepLabv3](deeplab.md), of `calibrate` and `colmap` in [Cameras](cameras.md), of `init` in
[Initial meshes](initial-meshes.md), of `fit` in [Fitting](fitting.md), of `published` in
[The page](page.md#published-curves).

"""


def on_files(files: Files, config: dict) -> Files:
    """Add the page of the configuration's keys."""
    page = CONFIGURATION + describe_configuration()
    files.append(File.generated(config, "configuration.md", content=page))
    return files
