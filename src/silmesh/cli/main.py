"""The command line: ``silmesh PHOTOS...`` and ``silmesh init``."""

from silmesh.cli.stop import MESSAGE, STOPPED, StoppingAtOnce, interrupt, on_signals

with StoppingAtOnce():
    import io
    import os
    import sys
    from importlib import import_module
    from pathlib import Path
    from typing import Any

    import click
    from click.shell_completion import CompletionItem

    from silmesh.errors import InputError
    from silmesh.files import NOT_OURS

# Heavier modules are imported where they are used, so that help and completion come at once.

MAKE = "make"  # what is meant where no command is named
WRONG, FAILED = 2, 1  # exit statuses; 0 also where the mesh is doubtful


class _Method(click.ParamType):
    """One of ours, or ``path/to/file.py:function``: a name of a list that is imported when needed.

    Args:
        module, names: where the list is
    """

    name = "method"

    def __init__(self, module: str, names: str):
        self._module, self._names = module, names

    @property
    def choices(self) -> tuple[str, ...]:
        return tuple(getattr(import_module(self._module), self._names))

    def convert(self, value: str, param: Any, ctx: Any) -> str:
        from silmesh.own_code import own_file

        if value not in self.choices and not own_file(value):
            self.fail(
                f"{value!r} is not one of {', '.join(self.choices)}, nor one of your own, "
                "path/to/file.py:function",
                param,
                ctx,
            )
        return value

    def get_metavar(self, param: click.Parameter, ctx: Any = None) -> str:
        return f"[{'|'.join(self.choices)}|FILE.py:FUNCTION]"

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[Any]:
        return [CompletionItem(name) for name in self.choices if name.startswith(incomplete)]


class _TextureSize(click.ParamType):
    """Pixels of a texture's side; the configuration says none as 0."""

    name = "size"
    words = ("auto", "none")

    def convert(self, value: str | int, param: Any, ctx: Any) -> str | int:
        if value == "none":
            return 0
        if value == "auto" or isinstance(value, int):
            return value
        try:
            return int(value)
        except ValueError:
            self.fail(f"{value!r} is neither 'auto', 'none' nor a number of pixels", param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: Any = None) -> str:
        return "[auto|none|PIXELS]"

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[Any]:
        return [CompletionItem(word) for word in self.words if word.startswith(incomplete)]


class _Make(click.Command):
    """The command without a name."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra):
        return super().make_context(parent.info_name if parent else info_name, args, None, **extra)


class _Commands(click.Group):
    """Commands, of which ``make`` needs no name: its help is that of all."""

    def main(self, *args: Any, **extra: Any) -> Any:
        with StoppingAtOnce():
            return super().main(*args, **extra)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ours = {*self.commands, "--help", "-h", "--version"}
        named = not args or args[0] in ours
        return super().parse_args(ctx, args if named else [MAKE, *args])

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        make = self.commands[MAKE]
        inside = click.Context(make, info_name=ctx.info_name)
        make.format_usage(inside, formatter)
        make.format_help_text(inside, formatter)
        make.format_options(inside, formatter)
        self.format_commands(ctx, formatter)
        self.format_epilog(ctx, formatter)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        make = self.commands[MAKE]
        inside = click.Context(make, info_name=ctx.info_name)
        words = make.shell_complete(inside, incomplete)
        if not incomplete.startswith("-"):
            words += make.params[0].shell_complete(inside, incomplete)
        return super().shell_complete(ctx, incomplete) + words


HELP = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(
    cls=_Commands,
    context_settings=HELP,
    epilog='Completion: eval "$(_SILMESH_COMPLETE=bash_source silmesh)" in ~/.bashrc; zsh_source '
    "and fish_source likewise.",
)
@click.version_option(package_name="silmesh")
def main() -> None:
    """Photographs to meshes."""
    for stream in (sys.stdout, sys.stderr):  # a name may have what a terminal cannot show
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@main.command(MAKE, cls=_Make, hidden=True, context_settings=HELP)
@click.argument("photos", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, writable=True),
    default="mesh.glb",
    show_default=True,
    help="The mesh to write: .glb or .obj (with .mtl and .png) with its texture, .ply with colours "
    "of its vertices, .stl.",
)
@click.option(
    "--page",
    type=click.Path(path_type=Path, writable=True),
    help="Also write a page to open in a browser: the mesh in 3D, the photographs with outlines.",
)
@click.option(
    "--masks",
    type=click.Path(path_type=Path),
    help="Folder of masks, white on the object, named like the photographs. One named masks in or "
    "beside their folder is found.",
)
@click.option(
    "--silhouettes",
    type=_Method("silmesh.settings.silhouettes", "SOURCES"),
    help="Where the object's outline comes from. Chosen by what the photographs show.",
)
@click.option(
    "--cameras",
    metavar="SOURCE",
    help="calibrate (the object turns), colmap (the camera moves), auto (the better of both), "
    "turntable (known: --turntable) or file:PATH. Chosen by what the photographs show.",
)
@click.option(
    "--turntable",
    metavar="D,E,S",
    default="",
    help="What is known of it: distance, elevation, step from photograph to photograph, as ,,5 "
    "for a step of 5 degrees; of several rounds each, as ',5,20;,40,20'.",
)
@click.option(
    "--sets",
    default="",
    help="Of photographs between which the object was turned over: folders or globs of names, as "
    "'upright*;turned*'.",
)
@click.option(
    "--detail",
    type=click.Choice(["draft", "normal", "high"]),
    help="draft: small and quick; normal: as without this; high: the photographs' own size, as far "
    "as 8 GiB reach. Time and memory are said beforehand.",
)
@click.option(
    "--size", type=int, help="Pixels of the working images. Default: that of --detail, 256."
)
@click.option("--init", default="hull", show_default=True, help="Initial mesh: its shape.")
@click.option(
    "--preset",
    type=_Method("silmesh.settings.fit", "FITS"),
    default="fast",
    show_default=True,
    help="How the mesh is fitted; softras is slow.",
)
@click.option(
    "--quality",
    type=click.Choice(["auto", "keep", "drop", "repair"]),
    default="auto",
    show_default=True,
    help="What is done with photographs whose outline the others contradict.",
)
@click.option(
    "--photometric",
    type=click.Choice(["auto", "none"]),
    help="Hollows that no outline shows, from photographs that agree: tried by the preset fast "
    "unless it is none, and taken if photographs that were kept out confirm it.",
)
@click.option(
    "--texture",
    type=_TextureSize(),
    default="auto",
    show_default=True,
    help="Side of the texture in pixels: auto by the photographs; none for colours of vertices.",
)
@click.option("--cores", type=click.IntRange(1), default=os.cpu_count(), help="Default: all.")
@click.option(
    "--keep",
    type=click.Path(path_type=Path, file_okay=False, writable=True),
    help="Folder to work in, with all results and logs, in place of one in the cache.",
)
@click.option("--verbose", is_flag=True, help="Show all that the workflow says.")
def make(photos: tuple[Path, ...], output: Path, **options: Any) -> None:
    """Make a mesh of one object from its PHOTOS: a folder (or one a round), files, or a video.

    Photograph the object all around, 20 to 100 times, whole and sharp: on a turntable before a
    plain background, or walking around it. Then:

        silmesh photos/ -o mesh.glb

    What was made is kept, so the same command goes on where it was stopped, and another option
    makes only what depends on it. It lies in ~/.cache/silmesh/objects (or $SILMESH_CACHE/objects),
    a folder an object: remove any of them, or all, to have the room back.
    """
    from silmesh.cli.make import make_mesh
    from silmesh.cli.runner import RunError

    try:
        on_signals(interrupt)
        make_mesh(photos, output, **options)
    except InputError as error:
        _end(str(error), WRONG)
    except RunError as error:
        _end(str(error), FAILED)
    except OSError as error:
        if error.errno not in NOT_OURS:
            raise
        _end(f"{error.filename}: {error.strerror}", FAILED)
    except KeyboardInterrupt:
        click.echo(MESSAGE, err=True)
        sys.exit(STOPPED)


@main.command(context_settings=HELP)
@click.argument(
    "folder", type=click.Path(path_type=Path, exists=True, file_okay=False, writable=True)
)
@click.option("--force", is_flag=True, help="Overwrite what is there.")
@click.option("--aloi", "layout", flag_value="aloi", help="FOLDER has ALOI's archives, unpacked.")
@click.option("--coil", "layout", flag_value="coil", help="FOLDER has COIL-20 or COIL-100.")
@click.option(
    "--shapenet",
    "layout",
    flag_value="shapenet",
    help="FOLDER has <class>_<split>_images.npz, and _voxels.npz.",
)
@click.option("--objects", metavar="LIST", help="Of these: numbers, as 1-10,17.")
@click.option(
    "--from",
    "source",
    metavar="ADDRESS",
    help="Of ALOI: https:// or s3:// address of the folder of its archives, of which the "
    "photographs of these objects are fetched when they are needed.",
)
def init(
    folder: Path, force: bool, layout: str | None, objects: str | None, source: str | None
) -> None:
    """Write a table and a configuration for a FOLDER of folders, each of one object's photographs.

    Or for a published data set of many objects.

    They can be edited, and are run by `snakemake`.
    """
    from silmesh.cli.init import write_project

    try:
        for line in write_project(folder, force, layout, objects, source):
            click.echo(line)
    except InputError as error:
        _end(str(error), WRONG)


def _end(message: str, status: int) -> None:
    click.echo(f"silmesh: {message}", err=True)
    sys.exit(status)
