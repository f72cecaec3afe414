"""Lay a texture on a fitted mesh, from its photographs at their own size."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
import torch

from silmesh.errors import blaming
from silmesh.evaluation.texturing import make_texture
from silmesh.files import replacing
from silmesh.geometry.camera import read_cameras
from silmesh.geometry.mesh_files import read_mesh, write_coloured
from silmesh.geometry.textured_mesh import (
    encode_png,
    texture_mesh,
    write_textured_glb,
    write_textured_obj,
)
from silmesh.progress import share_of
from silmesh.scene.scene import SILHOUETTES, VIEWS, read_scene
from silmesh.settings.texture import Texture
from silmesh.silhouettes import read_silhouettes
from silmesh.steps.command import add_settings, output_file, parser, run
from silmesh.texture.vertex_colours import colour_vertices
from silmesh.views import ImageFolder, Pictures, read_views


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    given = _parse(argv)
    torch.set_num_threads(given.threads)
    numba.set_num_threads(min(given.threads, numba.config.NUMBA_NUM_THREADS))
    cameras, mesh = read_cameras(given.cameras), read_mesh(given.mesh)
    silhouettes = read_silhouettes(given.scene / SILHOUETTES, cameras.views, given.threads)
    with blaming(given.name):
        baked = make_texture(
            mesh,
            cameras,
            read_views(given.views),
            read_scene(given.scene)[2].get("lenses"),
            silhouettes,
            given.settings,
            given.holdout,
            share_of(f"texture {given.name}"),
        )
    for warning in baked.notes["warnings"]:
        print(f"silmesh: {given.name}: {warning}", file=sys.stderr)
    pictures = Pictures(ImageFolder(given.scene / VIEWS), cameras.views)
    colours = colour_vertices(mesh.vertices, mesh.faces, cameras, pictures, silhouettes)
    write_coloured([given.coloured], mesh, colours)
    with replacing(given.notes) as part:
        part.write_text(json.dumps(baked.notes, indent=1) + "\n", encoding="utf-8")
    textured = texture_mesh(baked.verts, baked.faces, baked.uv, baked.image)
    png = encode_png(textured)
    write_textured_glb(given.glb, textured, png)
    write_textured_obj(given.output, textured, png, given.material, given.image)


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    args = parser(__doc__)
    args.add_argument("--mesh", type=Path, required=True, help="the fitted mesh")
    args.add_argument("--cameras", type=Path, required=True, help="cameras.json of its world")
    args.add_argument("--scene", type=Path, required=True, help="folder of the scene")
    args.add_argument("--views", type=Path, required=True, help="folder of the working images")
    add_settings(args, Texture)
    args.add_argument("--holdout", type=int, default=0, help="every n-th view was kept out")
    args.add_argument("--threads", type=int, default=torch.get_num_threads(), help="to use")
    args.add_argument("--name", default="texture", help="what progress lines call it")
    args.add_argument("--output", type=output_file, required=True, help="OBJ to write")
    args.add_argument("--material", type=output_file, required=True, help="its MTL to write")
    args.add_argument("--image", type=output_file, required=True, help="its PNG to write")
    args.add_argument("--glb", type=output_file, required=True, help="GLB to write")
    args.add_argument(
        "--coloured", type=output_file, required=True, help="mesh with colours of vertices to write"
    )
    args.add_argument("--notes", type=output_file, required=True, help="texture.json to write")
    return args.parse_args(argv)


if __name__ == "__main__":
    run(main)
