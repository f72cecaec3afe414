"""Adds to the site what is made from the code, from the notebook and from the changelog."""

import json
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path

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


NOTEBOOK = Path(__file__).with_name("notebook.ipynb")
CHANGELOG = Path(__file__).parents[1] / "CHANGELOG.md"
PNG, TEXT = "image/png", "text/plain"


def on_files(files: Files, config: dict) -> Files:
    """Add the pages of the configuration's keys and of the changes, and the notebook."""
    page = CONFIGURATION + describe_configuration()
    files.append(File.generated(config, "configuration.md", content=page))
    files.append(
        File.generated(config, "changes.md", content=CHANGELOG.read_text(encoding="utf-8"))
    )
    for name, content in read_notebook(NOTEBOOK).items():
        files.append(File.generated(config, name, content=content))
    return files


def read_notebook(file: Path) -> dict[str, str | bytes]:
    """The files of a notebook's page: its Markdown first, then the pictures in it."""
    page, pictures = [], {}
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        page.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for data in _outputs_of(cell):
            if PNG in data:
                name = f"{file.stem}-{len(pictures)}.png"
                pictures[name] = b64decode(data[PNG])
                page.append(f"![What the lines above draw]({name})")
            elif TEXT in data:
                page.append(f"```text\n{''.join(data[TEXT])}\n```")
    return {f"{file.stem}.md": "\n\n".join(page) + "\n", **pictures}


def _outputs_of(cell: dict) -> Iterator[dict]:
    """What a cell showed when it was run last, by type."""
    return (output["data"] for output in cell.get("outputs", []) if "data" in output)
