"""The files beside an OBJ with a texture: the MTL that it names, and the PNG that this names."""

import os
from pathlib import Path

from PIL import Image

from silmesh.errors import InputError
from silmesh.files import replacing, try_file

MARK = "silmesh"  # in a file that was made here
MADE = f"# {MARK}\n"  # begins an MTL that was made here
MATERIAL = f"""\
{MADE}newmtl texture
Ka 1 1 1
Kd 1 1 1
Ks 0 0 0
Ns 0
illum 1
Pr 1
Pm 0
map_Kd """


def name_companions(path: Path) -> tuple[Path, Path]:
    """The MTL and the PNG beside an OBJ."""
    return path.with_suffix(".mtl"), path.with_suffix(".png")


def try_companions(path: Path) -> None:
    """Try whether the MTL and the PNG of an OBJ can be written, over none that a person has there.

    Raises:
        InputError: they cannot
    """
    for companion in name_companions(path):
        try_file(companion)
        if os.path.lexists(companion) and not _is_ours(companion):
            raise InputError(
                f"{companion}: is there already and not made by silmesh, and {path.name} has its "
                f"{'texture' if companion.suffix == '.png' else 'material'} there; should be "
                f"elsewhere, or {path.name} be called otherwise, or be a .glb, which is one file"
            )


def write_obj(path: Path, lines: bytes, png: bytes, material: Path, image: Path) -> None:
    """Write an OBJ after the files that it names, so that it never names what is not there.

    Args:
        lines: of the OBJ, but for those that name files
        png: the content of the picture
        material, image: the MTL and the PNG to write
    """
    _write(image, png)
    _write(material, _describe_material(material, image))
    _write(path, _begin(os.path.relpath(material, path.parent)) + lines)


def copy_obj(made: Path, output: Path) -> None:
    """Copy an OBJ of ``write_obj``, with its MTL and PNG under the names of the copy.

    Raises:
        InputError: as ``try_companions``
    """
    try_companions(output)
    own, picture = name_companions(made)
    lines = made.read_bytes().removeprefix(_begin(own.name))
    write_obj(output, lines, picture.read_bytes(), *name_companions(output))


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as part:
        part.write_bytes(content)


def _is_ours(companion: Path) -> bool:
    """Whether an MTL or a PNG was made here."""
    try:
        if companion.suffix == ".mtl":
            with companion.open("rb") as file:
                return file.read(len(MADE)) == MADE.encode()
        with Image.open(companion) as image:
            return image.info.get("Software") == MARK
    except OSError:  # no picture, or a link to nothing
        return False


def _describe_material(material: Path, image: Path) -> bytes:
    return MATERIAL.encode() + os.fsencode(os.path.relpath(image, material.parent)) + b"\n"


def _begin(material: str) -> bytes:
    """The lines of an OBJ that name files."""
    return MADE.encode() + b"mtllib " + os.fsencode(material) + b"\nusemtl texture\n"
